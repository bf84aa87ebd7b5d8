"""One track without its filter: a frozen record, which only the tracker replaces."""

from typing import Final, NamedTuple

from onboard.estimators.kit.life_cycle import by_age
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Key, Report
from onboard.messages import AdsbVehicle, Lifecycle, MeasurementReport
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

MOST_SOURCES: Final = 16  # of one track, the newest: names of radars are unlimited


class Track(NamedTuple):
    """`target`: its name, with `key` the address that it reports, None where only a radar has detected it.
    `number` is unique. `sources`: time of the newest measurement of each source. `scan_hits` has a bit for each of
    the last `scans`, the newest lowest. `outliers`: its newest reports, where they fit each other and not the
    track. `measurement` and `sequence`: of the next estimate."""

    target: str
    key: Key | None
    number: int
    fused_ns: int
    sources: dict[str, int]
    adsb: AdsbVehicle | None = None
    last_report: Report | None = None  # of those that were fused
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
        """Whether it is published: if it reports an address, or a radar has detected it often enough."""
        return self.confirmed or self.key is not None

    def age(self, now_ns: int) -> float:
        """Seconds since the newest measurement that was fused."""
        return (now_ns - self.fused_ns) / NS_PER_S

    def life(self, now_ns: int, config: Config) -> tuple[Lifecycle, Reason]:
        """State and reason."""
        state, why = by_age(self.age(now_ns), config, one="report or echo", many="reports")
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
        """Whether it is to be removed: it has had no measurement for long, or its echoes were too few to confirm
        it."""
        if self.age(now_ns) > config.forget_after_s:
            return True
        if self.established:
            return False
        missed = self.scans >= 3 and self.scan_hits & 0b111 == 0  # three times in a row
        return missed or self.scans >= config.confirm_window or self.age(now_ns) > config.coast_after_s

    def fused(self, t_ns: int, source: str) -> "Track":
        """After a measurement of that time was fused."""
        sources = self.sources | {source: max(self.sources.get(source, 0), t_ns)}
        if len(sources) > MOST_SOURCES:
            del sources[min(sources, key=lambda s: sources[s])]
        return self._replace(fused_ns=max(self.fused_ns, t_ns), sources=sources)

    def reported(self, report: Report, measurement: MeasurementReport) -> "Track":
        """After a report of its address was fused."""
        return self.fused(report.t_ns, report.source)._replace(
            report_count=self.report_count + 1,
            last_report=report,
            confirmed=self.confirmed or self.report_count >= 1,
            adsb=report.adsb or self.adsb,
            measurement=measurement,
        )

    def begun_with(self, report: Report) -> "Track":
        """With its first report, which may have given it its name."""
        return self._replace(report_count=1, adsb=report.adsb)

    def scanned(self, *, hit: bool, config: Config) -> "Track":
        """After a radar scan with an echo of it, or without."""
        hits = (self.scan_hits << 1 | hit) & ((1 << config.confirm_window) - 1)
        confirmed = self.confirmed or hits.bit_count() >= config.confirm_hits
        return self._replace(scan_hits=hits, scans=self.scans + 1, confirmed=confirmed)

    def merged(self, other: "Track") -> "Track":
        """After the echoes of another track turned out to be its own."""
        whole = self._replace(scan_hits=other.scan_hits, scans=other.scans)
        for source, t_ns in other.sources.items():
            whole = whole.fused(t_ns, source)
        return whole


def name_of(key: Key | None, number: int, copy: int = 1) -> str:
    """The target's name, such as icao/4b1a2c, system/7 or radar/12; a second track of one address gets -2."""
    if key is None:
        return f"radar/{number}"
    kind, value = key
    text = f"icao/{value:06x}" if kind == "icao" else f"{kind}/{value}"
    return text if copy == 1 else f"{text}-{copy}"
