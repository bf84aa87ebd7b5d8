"""Detection of faults of our own vehicle, and its delay, against a simulator's truth."""

from collections.abc import Sequence
from typing import Final

from onboard.messages import Fault, FaultKind, NavState, Record, Truth
from onboard.units import NS_PER_S, S_PER_NS

GUST_SCENARIO: Final = "gust"  # Not a fault of the vehicle: in a flight with another fault, that one is scored.
FAULT_KINDS: Final = {"inputs": FaultKind.MASS, "mass": FaultKind.MASS, GUST_SCENARIO: FaultKind.GUST}
JUDGED_FAULTS: Final = (FaultKind.MOTOR, FaultKind.MASS, FaultKind.GUST)  # kinds that occur in the truth
MAX_REPORT_DELAY_NS: Final = 3 * NS_PER_S  # A past fault may still be reported for this long.


class FaultScore(Record, frozen=True, kw_only=True):
    """The score of a flight's fault.

    Attributes
    ----------
    happened, at_s
        Kind and onset of the true fault on the boot clock (to the truth's 0.04 s); None without one.
    named, after_s
        Name that the estimator first gave it, and the delay; None if it was not detected.
    magnitude, unit
        Last reported magnitude.
    wrong
        Reported faults that did not exist.
    """

    happened: str | None
    at_s: float | None
    named: str | None
    after_s: float | None
    magnitude: float | None
    unit: str | None
    wrong: tuple[str, ...]


def score_fault(states: Sequence[NavState], truths: Sequence[Truth]) -> FaultScore | None:
    """Return the score of one flight; None without states or truth."""
    if not states or not truths:
        return None
    intervals = _intervals(truths)
    happened = min(intervals, key=lambda name: (name == GUST_SCENARIO, intervals[name]), default=None)
    first: dict[tuple[FaultKind, str, int], int] = {}
    last: dict[tuple[FaultKind, str, int], Fault] = {}
    for s in states:
        for f in s.faults:
            first.setdefault((f.kind, f.part, f.t_onset_ns), s.t_ns)
            last[f.kind, f.part, f.t_onset_ns] = f
    at_ns = None if happened is None else intervals[happened][0]
    right = [
        key
        for key, t in first.items()
        if happened is not None and _is_true(happened, last[key], t, intervals[happened])
    ]
    named = min(right, key=lambda key: first[key], default=None)
    wrong = {
        _name(f)
        for key, f in last.items()
        if f.kind in JUDGED_FAULTS
        and not any(_is_true(name, f, first[key], span) for name, span in intervals.items())
    }
    return FaultScore(
        happened=happened,
        at_s=None if at_ns is None else at_ns * S_PER_NS,
        named=None if named is None else _name(last[named]),
        after_s=None if named is None or at_ns is None else (first[named] - at_ns) * S_PER_NS,
        magnitude=None if named is None else last[named].magnitude,
        unit=None if named is None else last[named].unit,
        wrong=tuple(sorted(wrong)),
    )


def _intervals(truths: Sequence[Truth]) -> dict[str, tuple[int, int]]:
    """Return start and end (ns) of each fault, by its name in the truth."""
    found: dict[str, tuple[int, int]] = {}
    for truth in truths:
        for name in filter(None, truth.fault.split(", ")):
            found[name] = (found.get(name, (truth.t_ns, 0))[0], truth.t_ns)
    return found


def _is_true(happened: str, fault: Fault, t_ns: int, span: tuple[int, int]) -> bool:
    """Return whether a fault first reported at t_ns is the true one."""
    same = fault.part == happened if fault.kind is FaultKind.MOTOR else FAULT_KINDS.get(happened) is fault.kind
    return same and span[0] <= t_ns <= span[1] + MAX_REPORT_DELAY_NS


def _name(fault: Fault) -> str:
    """Return a motor with its number, or the kind of any other fault."""
    return fault.part or str(fault.kind)
