"""One MAVLink component of ours on one link: it packs its messages, and answers commands addressed to it."""

from typing import Final

from onboard.autopilot.requests import UNSUPPORTED, Requests, stamp
from onboard.autopilot.sent import Encoder
from onboard.messages import Command, CommandAck, Heartbeat, Message, ParamRequest

TO_ALL: Final = 0  # as a target component
# MAV_TYPE, MAV_AUTOPILOT: no ground station takes it for a vehicle to command
ONBOARD_CONTROLLER, INVALID = 18, 8


def heartbeat(status: int, kind: int = ONBOARD_CONTROLLER) -> Heartbeat:
    """That of a component of ours, of this MAV_TYPE, in this MAV_STATE."""
    return Heartbeat(**stamp(0), vehicle_type=kind, autopilot=INVALID, armed=False, status=status)


class Component:
    """(system, component) and what may be requested of it."""

    def __init__(self, system: int, component: int, channel: str, requests: Requests) -> None:
        self._system, self._component, self._channel = system, component, channel
        self._requests = requests
        self._encoder = Encoder(system, component)

    def encode(self, message: Message) -> bytes:
        """A message of ours as a frame."""
        return self._encoder.encode(message)

    def is_target(self, m: Command | CommandAck | ParamRequest) -> bool:
        """Whether a message is addressed to us, or to all components of our system."""
        return m.target_system == self._system and m.target_component in {self._component, TO_ALL}

    def answer(self, m: Command, now_ns: int) -> list[bytes]:
        """COMMAND_ACK and what was requested. What all components are asked for and we do not have is left to the
        others."""
        answer = self._requests.answer(self._channel, m, now_ns)
        if answer.result == UNSUPPORTED and m.target_component == TO_ALL:
            return []
        ack = CommandAck(
            **stamp(now_ns),
            target_system=m.system,
            target_component=m.component,
            command=m.command,
            result=answer.result,
        )
        return [self.encode(ack), *map(self.encode, answer.messages)]
