"""Our own state as MAVLink's ODOMETRY, on a link that is named."""

from onboard.autopilot.sent import Encoder
from onboard.autopilot.stream import Stream
from onboard.messages import NavState
from onboard.wire.odometry import odometry_of


class OdometryStream:
    """Frames for states, at most `rate_hz` per second of flight. (system, component) is the sender."""

    def __init__(self, system: int, component: int, *, rate_hz: float) -> None:
        self._encoder = Encoder(system, component)
        self.stream = Stream(rate_hz)
        self.can_send = False

    def frames(self, state: NavState) -> list[bytes]:
        """The frame of this state, if it is due; also when time has gone back, as after a reboot."""
        self.can_send = state.mean is not None
        if not self.can_send or not self.stream.is_due(state.t_ns):
            return []
        odometry = odometry_of(state)
        if odometry is None:
            return []
        return [self._encoder.encode(odometry)]
