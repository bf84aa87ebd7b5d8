"""Traffic: every other aircraft around us, from ADS-B, other vehicles' positions or pseudoranges, and our radar.

Tracks live in one Cartesian frame (`_traffic_frame`), all filters in one batch at one time (`_traffic_batch`).
Reports wait for the next publication, when all that came are fused together; a radar scan is fused when it comes.
Both may be older than the filters: the model looks back. An address is an identity: what it says goes to its own
track and to no other; echoes go to the tracks they fit best. Those that are both heard and seen tell by how much
our own attitude is off (`_traffic_registration`).
"""

from collections import Counter
from typing import Final

from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.frame import Frame
from onboard.estimators.traffic.publication import tell
from onboard.estimators.traffic.radar_association import Seeing
from onboard.estimators.traffic.report_association import Hearing
from onboard.estimators.traffic.table import Table
from onboard.estimators.traffic.track import NS
from onboard.filters.belief import Belief
from onboard.geometry.camera import Camera
from onboard.messages import (
    AdsbVehicle,
    Estimate,
    GlobalPosition,
    Message,
    PeerPosition,
    PeerRanges,
    RadarScan,
)
from onboard.ownship import Ownship

__all__ = ["LISTENS", "Config", "Estimator"]

LISTENS: Final = (AdsbVehicle, PeerPosition, PeerRanges, RadarScan, GlobalPosition)
OWN_POSITION_TIMEOUT_S: Final = 3.0


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`."""

    def __init__(self, config: Config, camera: Camera) -> None:  # noqa: ARG002 - the protocol's signature
        if not config.coast_after_s <= config.validity_timeout_s <= config.forget_after_s:
            raise ValueError("coast_after_s <= validity_timeout_s <= forget_after_s must hold")
        if config.confirm_hits > config.confirm_window:
            raise ValueError("confirm_hits <= confirm_window must hold")
        self._config = config
        self._table = Table(config)
        self._hearing, self._seeing = Hearing(self._table), Seeing(self._table)
        self._frame = Frame(OWN_POSITION_TIMEOUT_S)
        self._next_ns = 0

    @property
    def verdicts(self) -> Counter[str]:
        """What became of every report and every echo, counted."""
        return self._table.verdicts

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Take a report or a scan. Nothing is told before the next publication is due."""
        if isinstance(message, GlobalPosition):
            self._frame.receive(message)
        elif isinstance(message, RadarScan):
            self._seeing.scan(message, self._frame, ownship)
        elif isinstance(message, AdsbVehicle | PeerPosition | PeerRanges):
            self._hearing.hear(message, self._frame)
        return []

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Every track's estimate, `publish_hz` times a second."""
        now_ns, table = ownship.now_ns, self._table
        if now_ns < self._next_ns:
            return []
        period_ns = round(NS / self._config.publish_hz)
        self._next_ns = max(self._next_ns + period_ns, now_ns + period_ns // 2)
        table.advance(now_ns)
        self._hearing.fuse()
        table.forget(now_ns)
        told, table.farewells = table.farewells, []
        own = self._frame.own(now_ns, ownship)
        if own is None:
            return told
        rows = [i for i, t in enumerate(table.tracks) if t.settled]
        mean, covariance = table.batch.belief()
        known = Belief(mean[rows], covariance[rows])
        return told + tell([table.tracks[i] for i in rows], known, own, self._frame, now_ns, self._config)

    def reset(self, reason: str) -> None:
        """Forget all tracks, all times and our own position."""
        self._table.clear(reason)
        self._hearing.clear()
        self._frame = Frame(OWN_POSITION_TIMEOUT_S)
        self._next_ns = 0
