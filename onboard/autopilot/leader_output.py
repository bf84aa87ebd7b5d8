"""The leader over MAVLink: a virtual leader that autopilots follow, and reports for ground stations. Sans-IO; off
unless the configuration names a link. Nothing is sent of an estimate that is not valid, except that it is not."""

from collections.abc import Iterator
from typing import Final

from onboard.autopilot.leader_messages import MAKE, OWN_SYSTEM, View
from onboard.autopilot.stream import Stream
from onboard.config import LeaderOutConfig
from onboard.geometry.units import NS_PER_S
from onboard.messages import Clock, Heartbeat, LeaderState
from onboard.wire.mavlink_encode import MavlinkEncoder

ONBOARD_CONTROLLER, INVALID = 18, 8  # MAV_TYPE, MAV_AUTOPILOT: no ground station takes it for a vehicle to command
STANDBY, ACTIVE = 3, 4  # MAV_STATE
TELLS_IDLE: Final = frozenset({"CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_TRACKING_GEO_STATUS"})


class LeaderOutput:
    """The messages of one `[[leader_out]]`. `streams` by MAVLink name. (system, component) are our own ids."""

    def __init__(self, config: LeaderOutConfig, system: int, component: int) -> None:
        self.link = config.link
        self.streams = {name: Stream(rate) for name, rate in config.rates_hz.items()}
        self._is_leader = not OWN_SYSTEM.isdisjoint(self.streams)
        self._us = MavlinkEncoder(system, component)
        self._virtual = MavlinkEncoder(config.system, config.component)
        self._next_heartbeat_ns = 0

    def frames(self, state: LeaderState | None, view: View | None, now_ns: int) -> list[bytes]:
        """Frames due at a time on this computer's clock."""
        frames = []
        if self._is_leader and now_ns >= self._next_heartbeat_ns:
            self._next_heartbeat_ns = now_ns + NS_PER_S
            frames.append(self._virtual.encode(_heartbeat(is_valid=state is not None and state.valid)))
        if state is not None and view is not None:
            frames.extend(self._reports(state, view, now_ns))
        return frames

    def can_send(self, name: str, state: LeaderState | None, view: View | None) -> bool:
        """Whether a message could be sent of this state."""
        if state is None or view is None or not (state.valid or name in TELLS_IDLE):
            return False
        return MAKE[name](state, view) is not None

    def _reports(self, state: LeaderState, view: View, now_ns: int) -> Iterator[bytes]:
        for name, stream in self.streams.items():
            if not (state.valid or name in TELLS_IDLE) or not stream.is_due(now_ns):
                continue
            message = MAKE[name](state, view)
            if message is not None:
                yield (self._virtual if name in OWN_SYSTEM else self._us).encode(message)


def _heartbeat(*, is_valid: bool) -> Heartbeat:
    status = ACTIVE if is_valid else STANDBY
    times = {"t_ns": 0, "t_recv_ns": 0}
    return Heartbeat(
        **times, clock=Clock.NONE, vehicle_type=ONBOARD_CONTROLLER, autopilot=INVALID, armed=False, status=status
    )
