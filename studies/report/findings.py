"""The findings of a study as records: claims and their verdicts, misprints, checks, tables."""

import math
from typing import Literal

from onboard.messages import Record

Verdict = Literal["holds", "holds only if", "does not hold", "not decided"]
Outcome = bool | None  # None: the runs do not decide (`sampling`)
Cell = str | float | None


class Claim(Record, frozen=True, kw_only=True):
    """A statement of the paper, where it stands, and what our runs show."""

    claim: str
    where: str
    verdict: Verdict
    evidence: str
    sampled: bool = True  # whether runs enter, so that few cannot decide it


class Misprint(Record, frozen=True, kw_only=True):
    """A misprinted formula: one of its results, and that of the right formula.

    `proven` tells whether the printed form failed and the right one held when this was computed.
    """

    where: str
    printed: str
    right: str
    proof: str
    printed_value: float | None
    right_value: float | None
    proven: bool


class Check(Record, frozen=True, kw_only=True):
    """A number of ours that must lie in [low, high], around that of an independent implementation."""

    name: str
    unit: str
    ours: float
    low: float | None
    high: float | None
    agrees: bool


class Table(Record, frozen=True, kw_only=True):
    """Numbers of many runs: units stand in the header."""

    title: str
    note: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


class Findings(Record, frozen=True, kw_only=True):
    """The contents of a report. Figures are names of files in its folder."""

    study: str
    title: str
    setting: str
    seeds: int
    first_seed: int
    tables: tuple[Table, ...]
    checks: tuple[Check, ...] = ()
    claims: tuple[Claim, ...]
    misprints: tuple[Misprint, ...] = ()
    figures: tuple[str, ...] = ()


def verdict(holds: Outcome, only_if: Outcome = False) -> Verdict:
    """Return the verdict on a claim that holds, perhaps under the condition of its evidence.

    It is not decided if the runs leave open which of these it is.
    """
    if holds:
        return "holds"
    if holds is None or only_if is None:
        return "not decided"
    return "holds only if" if only_if else "does not hold"


def within(value: float | None, low: float | None = None, high: float | None = None) -> bool:
    """Whether a value lies in [low, high]; None is an open side.

    A value that is None or not finite does not.
    """
    if value is None or not math.isfinite(value):
        return False
    return bool((low is None or value >= low) and (high is None or value <= high))


def check(name: str, unit: str, ours: float, low: float | None = None, high: float | None = None) -> Check:
    """A check with its verdict; NaN never agrees."""
    return Check(name=name, unit=unit, ours=ours, low=low, high=high, agrees=within(ours, low, high))


def near(name: str, unit: str, ours: float, expected: float, tolerance: float) -> Check:
    """A check of ours against a number and its tolerance."""
    return check(name, unit, ours, expected - tolerance, expected + tolerance)
