"""Queue of reports until the next publication.

Addresses are unlimited: new ones never displace a report of a known one.
"""

import math
from collections.abc import Collection, Iterator
from typing import Final

from onboard.arrays import Array
from onboard.estimators.kit.frame import Frame
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Key, Report, ReportMessage, make_report
from onboard.messages import AdsbVehicle, PeerRanges, Verdict

MAX_WAITING_REPORTS: Final = 5000  # More reports in a tenth of a second are a flood.
MAX_NEW_REPORT_COUNT: Final = 40  # From addresses without a track: a busy sky in a second.


def key_of(message: ReportMessage) -> Key:
    """Return the address of a report's sender."""
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
        """Queue a report, or return the verdict on an unusable one.

        `near`: r_OT_n (3,) of its track, if there is one; `known`: addresses with a track.
        """
        is_new = key_of(message) not in known
        if len(self._reports) >= MAX_WAITING_REPORTS or (is_new and self._new >= MAX_NEW_REPORT_COUNT):
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
        """Yield all reports, one of each address at a time.

        Each is then evaluated by a track that the earlier ones have corrected.
        """
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
        """Discard all reports."""
        self._reports, self._new = [], 0
