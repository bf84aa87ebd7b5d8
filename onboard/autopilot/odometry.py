"""Our own state as MAVLink's ODOMETRY, on the link that the configuration names."""

from onboard.autopilot.sent import Encoder
from onboard.autopilot.stream import Stream
from onboard.messages import NavState
from onboard.wire.odometry import odometry_of


class OdometryStream:
    """Encodes states as ODOMETRY from a sender, at most `rate_hz` of them a second."""

    def __init__(self, system: int, component: int, *, rate_hz: float) -> None:
        self._encoder = Encoder(system, component)
        self.stream = Stream(rate_hz)
        self.can_send = False

    def frames(self, state: NavState) -> list[bytes]:
        """Return a state's frame if it is due, or if time has gone back as after a reboot."""
        self.can_send = state.mean is not None
        if not self.can_send or not self.stream.is_due(state.t_ns):
            return []
        odometry = odometry_of(state)
        if odometry is None:
            return []
        return [self._encoder.encode(odometry)]
