"""Diagnosis of image stamps that are wrong.

It recognises the other clock, another unit, a clock that is whole hours, days or 1,024 weeks off, and a clock that
started at 0.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Final, NamedTuple

from onboard.messages.base import Clock
from onboard.units import NS_PER_S

STAMP_UNITS_NS: Final = {"nanoseconds": 1, "microseconds": 1_000, "milliseconds": 1_000_000, "seconds": NS_PER_S}
CLOCK_NAMES: Final = {Clock.HOST: "Unix time", Clock.BOOT: "the autopilot's time since its boot"}
# Usual errors of clocks (GPS week rollover, a wrong date, a time zone): name, seconds, maximum number of them.
CLOCK_STEPS: Final = (("{} x 1,024 weeks", 619_315_200, 3), ("{} days", 86_400, 400), ("{} hours", 3_600, 48))
SIM_TIME_REMEDY: Final = (
    "set `use_sim_time` of camera and detector to false: a ROS stamp is of this computer's clock"
)
CLOCK_TOLERANCE_NS: Final = 2 * NS_PER_S  # Stamps may be this far outside the interval of their clock.
MAX_STAMP_NS: Final = 2**63
# Unix time before 1972 is that of a clock that was never set.
MAX_UNSET_CLOCK_TIME_NS: Final = 2 * 365 * 86_400 * NS_PER_S


class Span(NamedTuple):
    """Interval of plausible stamps of one clock, ns."""

    begin: int
    end: int

    def contains(self, times: Sequence[int]) -> bool:
        """Return whether all times are within the interval."""
        return self.begin - CLOCK_TOLERANCE_NS <= min(times) and max(times) <= self.end + CLOCK_TOLERANCE_NS

    def __str__(self) -> str:
        """Return begin and end for a person: dates and times, UTC, or seconds since a boot."""
        if not MAX_UNSET_CLOCK_TIME_NS < self.begin <= self.end < MAX_STAMP_NS:
            return f"{self.begin / NS_PER_S:.3f} to {self.end / NS_PER_S:.3f} s"
        times = (datetime.fromtimestamp(t_ns / NS_PER_S, UTC) for t_ns in self)
        return " to ".join(f"{time:%Y-%m-%d %H:%M:%S}" for time in times)


class Reading(NamedTuple):
    """A diagnosis of stamps, in words that follow "is", and the remedy."""

    words: str
    remedy: str


def read_stamps(
    stamps: Sequence[int], clock: Clock, spans: Mapping[Clock, Span], *, is_ros: bool = False
) -> Reading | None:
    """Diagnose stamps of a clock by the interval of each clock.

    `is_ros`: the stamps are from headers of ROS messages, which name no clock. Returns None if the stamps are
    right, or if nothing explains them.
    """
    if clock in spans and spans[clock].contains(stamps):
        return None
    for unit, ns in STAMP_UNITS_NS.items():
        for of, span in spans.items():
            if span.contains([stamp * ns for stamp in stamps]):
                return _diagnose_clock_and_unit(clock, of, unit, ns, is_ros=is_ros)
    if clock is not Clock.HOST or clock not in spans:
        return None
    return _diagnose_clock_step(stamps, spans[clock]) or _diagnose_unset_clock(stamps, is_ros=is_ros)


UPTIME: Final = Reading(
    "of CLOCK_MONOTONIC, this computer's uptime, as libcamera and V4L2 stamp",
    "let the detector add `time.time_ns() - time.monotonic_ns()` to each `t_ns`, with `clock: host`",
)


def _diagnose_clock_and_unit(clock: Clock, of: Clock, unit: str, ns: int, *, is_ros: bool) -> Reading:
    """Describe stamps of another clock, in another unit, or both."""
    words, remedies = [CLOCK_NAMES[of] + ("" if ns == 1 else f" in {unit}")], list[str]()
    if ns != 1:
        words.append("expected are nanoseconds")
        remedies.append(f"send nanoseconds: {ns:,} times as much")
    if of is not clock:
        words.append("where a ROS stamp is Unix time" if is_ros else f"but `clock` is `{clock.value}`")
        remedies.append(SIM_TIME_REMEDY if is_ros else f"let the detector send `clock: {of.value}`")
    return Reading(", ".join(words), "; ".join(remedies))


def _diagnose_clock_step(stamps: Sequence[int], span: Span) -> Reading | None:
    """Diagnose a clock that is off by a whole number of one of `CLOCK_STEPS`."""
    by = min(stamps) - span.begin
    for name, seconds, most in CLOCK_STEPS:
        whole = seconds * NS_PER_S
        count = round(by / whole)
        if not 0 < abs(count) <= most or 2 * (span.end - span.begin) > whole:
            continue
        if span.contains([stamp - count * whole for stamp in stamps]):
            way = "ahead" if count > 0 else "behind"
            words = f"Unix time of a clock that is {name.format(abs(count))} {way}"
            return Reading(words, "set the clock of the computer that stamps, or the one that it is compared with")
    return None


def _diagnose_unset_clock(stamps: Sequence[int], *, is_ros: bool) -> Reading | None:
    """Diagnose a clock that started at 0 and was never set."""
    if not 0 <= min(stamps) < MAX_UNSET_CLOCK_TIME_NS:
        return None
    since = f"{min(stamps) / NS_PER_S:.1f} s after 1970"
    words = f"{since}, of a clock that began at 0, as a simulator's does, or was never set"
    if is_ros:
        return Reading(words, SIM_TIME_REMEDY)
    return Reading(words, "stamp by this computer's clock, or by the autopilot's with `clock: boot`")
