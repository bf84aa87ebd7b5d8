"""One MAVLink component of ours on one link: encodes messages and answers commands."""

from typing import Final

from onboard.autopilot.requests import UNSUPPORTED, Requests, stamp
from onboard.autopilot.sent import Encoder
from onboard.messages import Command, CommandAck, Heartbeat, Message, ParamRequest

ALL_COMPONENTS: Final = 0  # MAV_COMP_ID_ALL
# MAV_TYPE and MAV_AUTOPILOT by which no ground station commands us as a vehicle
ONBOARD_CONTROLLER, INVALID = 18, 8


def heartbeat(status: int, kind: int = ONBOARD_CONTROLLER) -> Heartbeat:
    """Make the heartbeat of a component of ours: its MAV_STATE and MAV_TYPE."""
    return Heartbeat(**stamp(0), vehicle_type=kind, autopilot=INVALID, armed=False, status=status)


class Component:
    """A sender of ours, by system and component, and the requests that it answers."""

    def __init__(self, system: int, component: int, channel: str, requests: Requests) -> None:
        self._system, self._component, self._channel = system, component, channel
        self._requests = requests
        self._encoder = Encoder(system, component)

    def encode(self, message: Message) -> bytes:
        """Encode a message of ours as a frame."""
        return self._encoder.encode(message)

    def is_target(self, m: Command | CommandAck | ParamRequest) -> bool:
        """Whether a message is addressed to us, or to all components of our system."""
        return m.target_system == self._system and m.target_component in {self._component, ALL_COMPONENTS}

    def answer(self, m: Command, now_ns: int) -> list[bytes]:
        """Return a COMMAND_ACK and what was requested.

        A command to all components that we do not support is left to the others."""
        answer = self._requests.answer(self._channel, m, now_ns)
        if answer.result == UNSUPPORTED and m.target_component == ALL_COMPONENTS:
            return []
        ack = CommandAck(
            **stamp(now_ns),
            target_system=m.system,
            target_component=m.component,
            command=m.command,
            result=answer.result,
        )
        return [self.encode(ack), *map(self.encode, answer.messages)]
