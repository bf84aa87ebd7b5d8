"""Errors of the quadrotor's tracks: scores of a run, and rows over all runs.

They are compared with the figures of another implementation.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import mean_bounds
from onboard.messages import Record
from onboard.models import quadrotor
from onboard.models.quadrotor import ATTITUDE, POSITION, RATES, VELOCITY
from studies.csvsf_quadrotor.cases import FAULT_TIME_S, Case
from studies.csvsf_quadrotor.filters import CKF, FORCE, THRUST, Track
from studies.csvsf_quadrotor.reference_flight import DT
from studies.report import runs
from studies.report.findings import within
from studies.report.runs import by_name, half_unit

DIVERGENCE_WINDOW_S: Final = 5.0  # at the end: it decides whether a run diverged
MIN_DIVERGED_SIGMAS: Final = 5.0  # mean error of some state, in standard deviations of its raw measurement

GROUPS: Final = {"velocity_m_s": VELOCITY, "rates_rad_s": RATES, "position_m": POSITION, "attitude_rad": ATTITUDE}
MEANS: Final = ("nees", "nis")

# Velocity, m/s, as printed: an independent implementation of the same scenario, over 60 seeds of its own.
REFERENCE: Final[dict[tuple[str, str], str]] = {
    (variant, method): value
    for method, values in {
        "ckf": (".0129", ".574", ".113", ".031"),
        "ckf-wide": (".033", ".041", ".033", ".100"),
        "svsf": (".048", ".048", ".048", ".145"),
        "csvsf-printed": (".034", ".040", ".034", ".092"),
        "csvsf": (".0129", ".083", ".065", ".140"),
        "csvsf-robust": (".0129", ".126", ".107", ".0138"),
    }.items()
    for variant, value in zip(("none", "weak", "motor", "outliers"), values, strict=True)
} | {("multirate-weak", "ckf"): "12.4", ("multirate-gusts", "ckf"): "5.4"}
# What is asked of a robust filter: variant, quantity, limit; None: 1 % above the CKF's own.
ASKED: Final = (
    ("none", "velocity_m_s", None),
    ("outliers", "velocity_m_s", 0.016),
    ("weak", "velocity_m_s", 0.09),
    ("motor", "rates_rad_s", 0.06),
)
# And, with a GPS at 10 Hz, of filters that have an accelerometer.
ASKED_SLOW: Final = (("multirate-weak", "velocity_m_s", 0.07), ("multirate-gust", "velocity_m_s", 0.3))
FAULTLESS_TOLERANCE: Final = 0.05  # as a fraction of the reference's figure, without a fault
FAULTY_TOLERANCE: Final = 0.10  # the same with a fault


class Score(Record, frozen=True, kw_only=True):
    """One run from 10 s on: RMS of the errors' lengths, mean NEES (12 degrees of freedom) and NIS.

    The NIS has as many degrees of freedom as the first sensor has components.
    """

    seed: int
    diverged: str | None  # why, or None
    velocity_m_s: float
    rates_rad_s: float
    position_m: float
    attitude_rad: float
    nees: float
    nis: float


class Row(runs.Row, frozen=True, kw_only=True):
    """Figures of all runs, the diverged ones too, as in the reference."""

    scores: tuple[Score, ...]


class Comparison(runs.Comparison, frozen=True, kw_only=True):
    """Our figure and the reference's; `tolerance` is 5 % of the latter without a fault, 10 % with one."""

    standard_error: float | None
    agrees_as_printed: bool  # with some number that is printed like the reference, which has two or three digits


class Limit(Record, frozen=True, kw_only=True):
    """A requirement of a robust filter, and whether a method meets it.

    `value` None is a figure that is not finite.
    """

    variant: str
    method: str
    quantity: str
    value: float | None
    limit: float
    met: bool


def score(seeds: Sequence[int], case: Case, track: Track) -> list[Score]:
    """Scores of each flight of a case."""
    begin = round(FAULT_TIME_S / DT)
    error = track.mean[begin:] - case.states[begin + 1 :]
    figures = {name: np.sqrt(np.mean(np.sum(error[..., g] ** 2, axis=2), axis=0)) for name, g in GROUPS.items()}
    return [
        Score(
            seed=seed,
            diverged=_diverged(error[:, b], case.R),
            **{name: float(values[b]) for name, values in figures.items()},
            nees=float(track.nees[b]),
            nis=float(track.nis[b]),
        )
        for b, seed in enumerate(seeds)
    ]


def _diverged(error: Array, R: Array) -> str | None:
    """Return why one run diverged, by its error (N, 12), or None."""
    if not np.isfinite(error).all():
        return "numerical failure"
    off = np.mean(np.abs(error[-round(DIVERGENCE_WINDOW_S / DT) :]), axis=0) / np.sqrt(np.diag(R))
    worst = int(np.argmax(off))
    return quadrotor.COMPONENTS[worst] if off[worst] > MIN_DIVERGED_SIGMAS else None


def make_row(variant: str, method: str, scores: Sequence[Score]) -> Row:
    """The row of these runs."""
    quantities = {name: runs.rms([getattr(s, name) for s in scores]) for name in GROUPS}
    quantities |= {name: runs.mean([getattr(s, name) for s in scores]) for name in MEANS}
    gone = [s.diverged for s in scores if s.diverged is not None]
    return Row(
        variant=variant,
        method=method,
        runs=len(scores),
        diverged_percent=100.0 * len(gone) / len(scores),
        diverged_why=tuple(sorted(set(gone))),
        quantities=quantities,
        nees_bounds=mean_bounds(quadrotor.STATE_SIZE, len(scores)),
        scores=tuple(scores),
    )


def compare(row: Row) -> list[Comparison]:
    """The figure that the reference has for this row, if any."""
    printed = REFERENCE.get((row.variant, row.method))
    if printed is None:
        return []
    found = row.quantities["velocity_m_s"]
    reference, allowed = float(printed), FAULTLESS_TOLERANCE if row.variant == "none" else FAULTY_TOLERANCE
    off = float("inf") if found.value is None else abs(found.value - reference)
    return [
        Comparison(
            variant=row.variant,
            method=row.method,
            quantity="velocity_m_s",
            ours=found.value,
            standard_error=found.standard_error,
            reference=reference,
            tolerance=reference * allowed,
            agrees=off <= reference * allowed,
            agrees_as_printed=off <= reference * allowed + half_unit(printed) * (1 + allowed),
        )
    ]


def limits_of(rows: Sequence[Row], methods: Sequence[str]) -> list[Limit]:
    """Return whether each of `methods` meets ASKED, and those with a GPS at 10 Hz ASKED_SLOW."""
    known = by_name(rows)
    like_ckf = 1.01 * known["none", "ckf"].value("velocity_m_s")
    slow = (CKF.name, *(m.name for m in (*THRUST, *FORCE)))
    return [
        _limit(known[variant, method], quantity, like_ckf if limit is None else limit)
        for asked, of in ((ASKED, methods), (ASKED_SLOW, slow))
        for method in of
        for variant, quantity, limit in asked
    ]


def _limit(row: Row, quantity: str, limit: float) -> Limit:
    value = row.quantities[quantity].value
    met = within(value, high=limit) and row.diverged_percent == 0
    return Limit(variant=row.variant, method=row.method, quantity=quantity, value=value, limit=limit, met=met)
