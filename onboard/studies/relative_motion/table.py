"""Scores of many runs in one row, and beside them what an independent implementation measured."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import mean_bounds
from onboard.messages import Record
from onboard.studies.relative_motion.bound import Bound
from onboard.studies.relative_motion.scores import Score

FT: Final = 0.3048
RMS: Final = ("position_ft", "velocity_ft_s", "range_percent", "size_percent", "a_lat_ft_s2", "a_long_ft_s2")
MEANS: Final = ("nees", "nis")
OF_ALL: Final = ("inside_percent", "inside_unseen_percent", "told_percent")  # also of runs that diverged: no lies
SLOWEST: Final = 0.95  # of runs have converged by the time that is judged

# Measured by an independent implementation of the same scenario over 50 seeds of its own. Position and velocity
# in feet; over the runs that did not diverge.
REFERENCE: Final[dict[tuple[str, str], dict[str, float]]] = {
    ("a", "paper"): {
        "position_ft": 2.72,
        "velocity_ft_s": 0.86,
        "range_percent": 3.0,
        "a_lat_ft_s2": 0.09,
        "nees": 0.19,
        "nis": 0.003,
        "diverged_percent": 0.0,
    },
    ("a", "tuned"): {
        "position_ft": 3.06,
        "velocity_ft_s": 0.46,
        "range_percent": 3.4,
        "a_lat_ft_s2": 0.33,
        "nees": 13.5,
        "nis": 2.9,
        "diverged_percent": 0.0,
    },
    ("d", "printed"): {
        "position_ft": 6.31,
        "velocity_ft_s": 3.22,
        "range_percent": 5.8,
        "a_lat_ft_s2": 0.20,
        "nees": 0.33,
        "nis": 0.01,
        "diverged_percent": 24.0,
    },
    ("e", "tuned"): {"diverged_percent": 99.0},
}
REFERENCE_RUNS: Final = 50
# half a unit of the last digit printed above
ROUNDING: Final = {
    "position_ft": 0.005,
    "velocity_ft_s": 0.005,
    "range_percent": 0.05,
    "a_lat_ft_s2": 0.005,
    "nees": 0.005,
    "nis": 0.0005,
    "diverged_percent": 1.0,
}
COARSE_ROUNDING: Final = {
    ("a", "tuned", "nees"): 0.05,
    ("a", "tuned", "nis"): 0.05,
    ("d", "printed", "nis"): 0.005,
}
SIGMAS: Final = 2.0


class Quantity(Record, frozen=True, kw_only=True):
    """A figure over runs, as a rule those that did not diverge, and its standard error from their scatter."""

    value: float | None
    standard_error: float | None


class Row(Record, frozen=True, kw_only=True):
    """One variant with one method."""

    variant: str
    method: str
    runs: int
    diverged_percent: float
    diverged_why: tuple[str, ...]
    quantities: dict[str, Quantity]
    position_m: float | None
    velocity_m_s: float | None
    a_lat_m_s2: float | None
    a_lat_converged_s: float | None  # median
    a_lat_converged_95_s: float | None  # by when 95 % of all runs had, None: never
    nees_bounds: tuple[float, float]  # 95 %, were each run's mean one sample: a consistent filter stays below
    nis_bounds: tuple[float, float]  # the same of the NIS
    nis_degrees: int
    position_sigma_ft: tuple[float, ...]  # reported (root mean square) before, in and after a drop-out
    delay_at_20_s_ms: float | None  # root mean square
    delay_error_ms: float | None  # largest of 95 % of runs after 20 s, of a method that estimates the delay
    delay_found_s: float | None  # by when 95 % of runs had it to stay within 15 ms
    scores: tuple[Score, ...]


class Limit(Record, frozen=True, kw_only=True):
    """The Cramer-Rao bound over all flights of a variant."""

    variant: str
    position_ft: float
    velocity_ft_s: float
    range_percent: float
    a_lat_ft_s2: float


class Comparison(Record, frozen=True, kw_only=True):
    """Ours against the reference. `tolerance`: two standard errors of the difference of two independent sets of
    runs, by the scatter of ours, and half a unit of the last digit that the reference states."""

    variant: str
    method: str
    quantity: str
    ours: float | None
    reference: float
    tolerance: float | None
    agrees: bool


def make_row(variant: str, method: str, scores: Sequence[Score]) -> Row:
    """The row of these runs."""
    kept = [s for s in scores if s.diverged is None]
    quantities = {name: _rms([getattr(s, name) for s in kept]) for name in RMS}
    quantities |= {name: _mean([getattr(s, name) for s in kept]) for name in MEANS}
    quantities |= {name: _mean(_known([getattr(s, name) for s in scores])) for name in OF_ALL}
    times = [s.a_lat_converged_s for s in kept if s.a_lat_converged_s is not None]
    nis_degrees = scores[0].nis_degrees
    at_20_s = [s.delay_at_20_s_ms for s in kept if s.delay_at_20_s_ms is not None]
    delays = [s.delay_error_ms for s in kept if s.delay_error_ms is not None]
    return Row(
        variant=variant,
        method=method,
        runs=len(scores),
        diverged_percent=100.0 * (1.0 - len(kept) / len(scores)),
        diverged_why=tuple(sorted({s.diverged.split(" at ")[0] for s in scores if s.diverged is not None})),
        quantities=quantities,
        position_m=_si(quantities["position_ft"]),
        velocity_m_s=_si(quantities["velocity_ft_s"]),
        a_lat_m_s2=_si(quantities["a_lat_ft_s2"]),
        a_lat_converged_s=float(np.median(times)) if times else None,
        a_lat_converged_95_s=_by_when([s.a_lat_converged_s for s in scores]),
        nees_bounds=mean_bounds(9, max(len(kept), 1)),
        nis_bounds=mean_bounds(nis_degrees, max(len(kept), 1)),
        nis_degrees=nis_degrees,
        position_sigma_ft=tuple(_rms([s.position_sigma_ft[i] for s in kept]).value or np.nan for i in range(3)),
        delay_at_20_s_ms=_rms(at_20_s).value,
        delay_error_ms=float(np.quantile(delays, SLOWEST)) if delays else None,
        delay_found_s=_by_when([s.delay_found_s for s in scores]),
        scores=tuple(scores),
    )


def make_bound(variant: str, bounds: Sequence[Bound]) -> Limit:
    """The bound over all of them: root mean squares."""
    names = ("position_ft", "velocity_ft_s", "range_percent", "a_lat_ft_s2")
    return Limit(variant=variant, **{name: _rms([getattr(b, name) for b in bounds]).value for name in names})  # type: ignore[arg-type]


def _known(values: Sequence[float | None]) -> list[float]:
    return [x for x in values if x is not None and np.isfinite(x)]


def _by_when(times: Sequence[float | None]) -> float | None:
    """The time by which 95 % of the runs had got there; None when fewer ever did."""
    when = float(np.quantile([np.inf if t is None else t for t in times], SLOWEST, method="higher"))
    return when if np.isfinite(when) else None


def compare(row: Row) -> list[Comparison]:
    """Each figure that the reference has for this row."""
    reference = REFERENCE.get((row.variant, row.method), {})
    return [_compare(row, quantity, value) for quantity, value in reference.items()]


def _compare(row: Row, quantity: str, reference: float) -> Comparison:
    if quantity == "diverged_percent":
        both = (row.diverged_percent + reference) / 200.0
        ours: float | None = row.diverged_percent
        error: float | None = 100.0 * float(np.sqrt(both * (1 - both) / row.runs))
    else:
        ours, error = row.quantities[quantity].value, row.quantities[quantity].standard_error
    rounding = COARSE_ROUNDING.get((row.variant, row.method, quantity), ROUNDING[quantity])
    tolerance = None
    if error is not None:
        tolerance = SIGMAS * error * float(np.sqrt(1.0 + row.runs / REFERENCE_RUNS)) + rounding
    return Comparison(
        variant=row.variant,
        method=row.method,
        quantity=quantity,
        ours=ours,
        reference=reference,
        tolerance=tolerance,
        agrees=ours is not None and tolerance is not None and abs(ours - reference) <= tolerance,
    )


def _rms(values: Sequence[float]) -> Quantity:
    """Root of the mean square over runs; every run has as many samples, so this is that over all samples."""
    x = np.array(values)
    if not x.size:
        return Quantity(value=None, standard_error=None)
    value = float(np.sqrt(np.mean(x * x)))
    # d sqrt(s) = ds / (2 sqrt(s))
    return Quantity(value=value, standard_error=_standard_error(x * x, 2.0 * value) if value > 0 else 0.0)


def _mean(values: Sequence[float]) -> Quantity:
    x = np.array(values)
    if not x.size:
        return Quantity(value=None, standard_error=None)
    return Quantity(value=float(np.mean(x)), standard_error=_standard_error(x, 1.0))


def _standard_error(x: Array, divisor: float) -> float | None:
    return float(np.std(x, ddof=1) / np.sqrt(x.size) / divisor) if x.size > 1 else None


def _si(quantity: Quantity) -> float | None:
    return None if quantity.value is None else quantity.value * FT
