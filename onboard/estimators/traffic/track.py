"""What is kept of one track beside its filter, and what is told of it."""

from dataclasses import dataclass, field
from typing import Final

from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Key, Report
from onboard.messages import AdsbVehicle, Lifecycle, MeasurementReport

NS: Final = 1_000_000_000


@dataclass(slots=True, eq=False)
class Track:
    """`key` is who it says it is, None for what only a radar has seen. `hits` holds a bit for each scan of late,
    the newest lowest."""

    target: str
    key: Key | None
    fused_ns: int
    number: int
    heard: AdsbVehicle | None = None
    sources: dict[str, int] = field(default_factory=dict)
    reports: int = 0
    hits: int = 0
    scans: int = 0
    confirmed: bool = False
    shared: bool = False  # its address is another track's, too
    resets: int = 0
    sequence: int = 0
    report: Report | None = None  # the last that was fused
    strays: list[Report] = field(default_factory=list)
    said: MeasurementReport | None = None

    @property
    def settled(self) -> bool:
        """Whether it is told of: what has said who it is, and what a radar has seen often enough."""
        return self.confirmed or self.key is not None

    def age(self, now_ns: int) -> float:
        """Seconds since the last measurement that was fused."""
        return (now_ns - self.fused_ns) / NS

    def life(self, now_ns: int, config: Config) -> tuple[Lifecycle, str]:
        """State and reason."""
        age = self.age(now_ns)
        if age > config.validity_timeout_s:
            return Lifecycle.LOST, "nothing heard or seen of it within the validity timeout"
        if not self.confirmed:
            return Lifecycle.INITIALISING, "heard once"
        shared = "; its address is used by another track too" if self.shared else ""
        if age > config.coast_after_s:
            return Lifecycle.COASTING, f"nothing heard or seen of it lately: predicted{shared}"
        by = ", ".join(s for s, t_ns in self.sources.items() if (now_ns - t_ns) / NS <= config.coast_after_s)
        return Lifecycle.TRACKING, f"by {by or 'reports'}{shared}"

    def fuse(self, t_ns: int, source: str) -> None:
        """A measurement has been fused."""
        self.fused_ns = max(self.fused_ns, t_ns)
        self.sources[source] = max(self.sources.get(source, 0), t_ns)

    def scan(self, *, hit: bool, config: Config) -> bool:
        """A radar scan has passed, in which it was seen or not. Whether that has made it a track."""
        self.hits = (self.hits << 1 | hit) & ((1 << config.confirm_window) - 1)
        self.scans += 1
        if self.settled or self.hits.bit_count() < config.confirm_hits:
            self.confirmed = self.confirmed or self.hits.bit_count() >= config.confirm_hits
            return False
        self.confirmed = True
        return True

    def hopeless(self, now_ns: int, config: Config) -> bool:
        """Whether it is to be forgotten: unheard of for long, or a begin that came to nothing."""
        if self.age(now_ns) > config.forget_after_s:
            return True
        if self.settled:
            return False
        # seen in less than a third of its scans, or three times in a row not
        missed = self.scans >= 3 and self.hits & 0b111 == 0
        return missed or self.scans >= config.confirm_window or self.age(now_ns) > config.coast_after_s


def name_of(key: Key | None, number: int, copy: int) -> str:
    """The target's name, such as icao/4b1a2c, system/7 or radar/12; a second of one address gets -2."""
    if key is None:
        return f"radar/{number}"
    kind, value = key
    text = f"icao/{value:06x}" if kind == "icao" else f"{kind}/{value}"
    return text if copy == 1 else f"{text}-{copy}"
