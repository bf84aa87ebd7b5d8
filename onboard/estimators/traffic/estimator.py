"""Traffic: all other aircraft, from their own reports and from our radar.

Reports are ADS-B, other vehicles' positions and pseudoranges. Tracks are kept in one Cartesian frame (`frame`). An
address is an identity: its reports go to its own track and to no other (`report_association`). Echoes go to the
tracks that they fit best (`radar_association`). Aircraft with both reveal the error of our own attitude
(`registration`).
"""

from collections import Counter
from typing import Final

from onboard.estimators.kit.frame import Frame
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.publication import estimates
from onboard.estimators.traffic.tracker import Tracker
from onboard.geometry.camera import Camera
from onboard.messages import (
    AdsbVehicle,
    Barometer,
    Estimate,
    GlobalPosition,
    Message,
    PeerPosition,
    PeerRanges,
    RadarScan,
)
from onboard.messages.causes import Reason
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

__all__ = ["LISTENS", "Config", "Estimator"]

LISTENS: Final = (AdsbVehicle, Barometer, PeerPosition, PeerRanges, RadarScan, GlobalPosition)


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`."""

    def __init__(self, config: Config, camera: Camera) -> None:  # noqa: ARG002 - the protocol's signature
        self._config = config
        self._tracker = Tracker(config)
        self._frame = Frame()
        self._next_ns = 0

    @property
    def verdicts(self) -> Counter[str]:
        """Counts of the verdicts on all reports and echoes."""
        return self._tracker.verdicts

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Receive a report or a scan. Estimates are published by `tick` only."""
        if isinstance(message, GlobalPosition):
            self._frame.receive(message)
        elif isinstance(message, Barometer):
            self._frame.receive_pressure(message)
        elif isinstance(message, RadarScan):
            self._tracker.fuse_scan(message, self._frame.own_motion(message.t_ns, ownship))
        elif isinstance(message, AdsbVehicle | PeerPosition | PeerRanges):
            self._tracker.receive(message, self._frame)
        return []

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Return every track's estimate, `publish_hz` times a second."""
        now_ns, tracker = ownship.now_ns, self._tracker
        if now_ns < self._next_ns:
            return []
        period_ns = round(NS_PER_S / self._config.publish_hz)
        self._next_ns = max(self._next_ns + period_ns, now_ns + period_ns // 2)
        tracker.advance(now_ns)
        tracker.fuse_reports()
        tracker.remove_expired(now_ns)
        ended = tracker.publish_ended()
        own = self._frame.own_motion(now_ns, ownship)
        if own is None:
            return ended
        return ended + estimates(*tracker.publish(own), own, self._frame, now_ns, self._config)

    def reset(self, why: Reason) -> None:
        """Remove all tracks and forget all times and our own position."""
        self._tracker.clear(why)
        self._frame = Frame()
        self._next_ns = 0
