"""One track without its filter: a frozen record, which only the tracker replaces."""

from typing import Final, NamedTuple

from onboard.estimators.kit.life_cycle import life_by_age
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Key, Report
from onboard.messages import AdsbVehicle, Lifecycle, MeasurementReport
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

MAX_SOURCES_PER_TRACK: Final = 16  # The newest are kept: names of radars are unlimited.


class Track(NamedTuple):
    """A track without its filter.

    Attributes
    ----------
    target, key
        Its name, and the address that it reports; None if only a radar has detected it.
    number
        Its unique number.
    sources
        Time of the newest measurement of each source.
    scans, scan_hits
        Number of scans, and a bit for each of the last ones with an echo, the newest lowest.
    outliers
        Its newest reports if they fit each other and not the track.
    measurement, sequence
        Those of the next estimate.
    """

    target: str
    key: Key | None
    number: int
    fused_ns: int
    sources: dict[str, int]
    adsb: AdsbVehicle | None = None
    last_report: Report | None = None  # the last fused one
    report_count: int = 0
    outliers: tuple[Report, ...] = ()
    scan_hits: int = 0
    scans: int = 0
    confirmed: bool = False
    address_shared: bool = False  # with another track
    resets: int = 0
    sequence: int = 0
    measurement: MeasurementReport | None = None

    @property
    def established(self) -> bool:
        """Whether it is published: it reports an address, or a radar has detected it often enough."""
        return self.confirmed or self.key is not None

    def age(self, now_ns: int) -> float:
        """Return the seconds since its newest fused measurement."""
        return (now_ns - self.fused_ns) / NS_PER_S

    def life(self, now_ns: int, config: Config) -> tuple[Lifecycle, Reason]:
        """Return state and reason."""
        state, why = life_by_age(self.age(now_ns), config, one="report or echo", many="reports")
        if state is Lifecycle.LOST:
            return state, why
        if not self.confirmed:
            return Lifecycle.INITIALISING, Reason(Cause.STARTING, "one report so far")
        if state is Lifecycle.TRACKING:
            newest = ((s, (now_ns - t_ns) / NS_PER_S) for s, t_ns in self.sources.items())
            by = ", ".join(s for s, age_s in newest if age_s <= config.coast_after_s)
            why = Reason(why.cause, f"by {by or 'reports'}")
        return state, why.also("its address is used by another track too") if self.address_shared else why

    def expired(self, now_ns: int, config: Config) -> bool:
        """Return whether it must be removed.

        That is without a recent measurement, or with too few echoes to be confirmed.
        """
        if self.age(now_ns) > config.forget_after_s:
            return True
        if self.established:
            return False
        missed = self.scans >= 3 and self.scan_hits & 0b111 == 0  # no echo in three consecutive scans
        return missed or self.scans >= config.confirm_window or self.age(now_ns) > config.coast_after_s

    def fused(self, t_ns: int, source: str) -> "Track":
        """Return the track after a measurement of that time was fused."""
        sources = self.sources | {source: max(self.sources.get(source, 0), t_ns)}
        if len(sources) > MAX_SOURCES_PER_TRACK:
            del sources[min(sources, key=lambda s: sources[s])]
        return self._replace(fused_ns=max(self.fused_ns, t_ns), sources=sources)

    def reported(self, report: Report, measurement: MeasurementReport) -> "Track":
        """Return the track after a report of its address was fused."""
        return self.fused(report.t_ns, report.source)._replace(
            report_count=self.report_count + 1,
            last_report=report,
            confirmed=self.confirmed or self.report_count >= 1,
            adsb=report.adsb or self.adsb,
            measurement=measurement,
        )

    def with_first_report(self, report: Report) -> "Track":
        """Return the track with its first report, which may have given it its name."""
        return self._replace(report_count=1, adsb=report.adsb)

    def scanned(self, *, hit: bool, config: Config) -> "Track":
        """Return the track after a radar scan with or without an echo of it."""
        hits = (self.scan_hits << 1 | hit) & ((1 << config.confirm_window) - 1)
        confirmed = self.confirmed or hits.bit_count() >= config.confirm_hits
        return self._replace(scan_hits=hits, scans=self.scans + 1, confirmed=confirmed)

    def merged(self, other: "Track") -> "Track":
        """Return the track after the echoes of another track turned out to be its own."""
        whole = self._replace(scan_hits=other.scan_hits, scans=other.scans)
        for source, t_ns in other.sources.items():
            whole = whole.fused(t_ns, source)
        return whole


def name_of(key: Key | None, number: int, copy: int = 1) -> str:
    """Return the target's name, such as icao/4b1a2c, system/7 or radar/12.

    A second track of an address gets -2.
    """
    if key is None:
        return f"radar/{number}"
    kind, value = key
    text = f"icao/{value:06x}" if kind == "icao" else f"{kind}/{value}"
    return text if copy == 1 else f"{text}-{copy}"
