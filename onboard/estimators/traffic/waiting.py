"""Reports that wait for the next publication. Addresses are unlimited: new ones cost a known one no report."""

import math
from collections.abc import Collection, Iterator
from typing import Final

from onboard.arrays import Array
from onboard.estimators.kit.frame import Frame
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Key, Report, ReportMessage, make_report
from onboard.messages import AdsbVehicle, PeerRanges, Verdict

MOST: Final = 5000  # reports; more in a tenth of a second is a flood
MOST_NEW: Final = 40  # of addresses without a track: all of a busy sky in a second


def key_of(message: ReportMessage) -> Key:
    """Whose report a message is."""
    if isinstance(message, AdsbVehicle):
        return "icao", message.icao
    return "system", message.peer if isinstance(message, PeerRanges) else message.system


class WaitingReports:
    """The reports since the last publication."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._reports: list[Report] = []
        self._new = 0

    def add(
        self, message: ReportMessage, frame: Frame, near: Array | None, known: Collection[Key | None]
    ) -> Verdict | None:
        """A report, or why it cannot be used. `near`: r_OT_n (3,) of its track, if there is one; `known`:
        addresses with a track."""
        is_new = key_of(message) not in known
        if len(self._reports) >= MOST or (is_new and self._new >= MOST_NEW):
            return Verdict.FULL
        report = make_report(message, frame, self._config, near)
        if isinstance(report, Verdict):
            return report
        if is_new and report.adsb is not None and not self._config.own_icao:
            sigma = math.hypot(self._config.adsb_position_sigma_m, self._config.report_bias_m)
            if frame.is_here(report.t_ns, report.y, sigma):
                return Verdict.OURSELVES  # our own transponder, heard by our own receiver
        self._new += is_new
        self._reports.append(report)
        return None

    def take(self) -> Iterator[list[Report]]:
        """All reports, one of each address at a time, so that each is judged by a track that has been corrected by
        those before it."""
        waiting, self._reports, self._new = self._reports, [], 0
        while waiting:
            now: dict[Key, Report] = {}
            later = []
            for report in waiting:
                if report.key in now:
                    later.append(report)
                else:
                    now[report.key] = report
            yield list(now.values())
            waiting = later

    def clear(self) -> None:
        """Forget them."""
        self._reports, self._new = [], 0
