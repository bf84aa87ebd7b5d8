"""Figures of merit over many runs of a method in a variant, with those of another implementation."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from onboard.arrays import Array
from onboard.messages import Record


class Quantity(Record, frozen=True, kw_only=True):
    """A figure over runs, and its standard error by their scatter. None: unknown."""

    value: float | None
    standard_error: float | None


class Row(Record, frozen=True, kw_only=True):
    """One variant with one method, over its runs."""

    variant: str
    method: str
    runs: int
    diverged_percent: float
    diverged_why: tuple[str, ...]
    quantities: dict[str, Quantity]
    nees_bounds: tuple[float, float]  # 95 % of a consistent filter's mean NEES, with each run's mean as one sample

    def value(self, quantity: str) -> float:
        """A figure of this row; NaN where it is unknown."""
        value = self.quantities[quantity].value
        return float("nan") if value is None else value


class Comparison(Record, frozen=True, kw_only=True):
    """A figure of ours beside that of another implementation."""

    variant: str
    method: str
    quantity: str
    ours: float | None
    reference: float
    tolerance: float | None
    agrees: bool


R = TypeVar("R", bound=Row)


def by_name(rows: Iterable[R]) -> dict[tuple[str, str], R]:
    """Rows by their variant and method."""
    return {(row.variant, row.method): row for row in rows}


def rms(values: Sequence[float]) -> Quantity:
    """Return the root of the mean square over runs, all with the same number of samples.

    It is None without runs, and if a run has no finite figure.
    """
    x = np.array(values)
    if not x.size or not np.isfinite(x).all():
        return Quantity(value=None, standard_error=None)
    value = float(np.sqrt(np.mean(x * x)))
    # d sqrt(s) = ds / (2 sqrt(s))
    return Quantity(value=value, standard_error=_standard_error(x * x, 2.0 * value) if value > 0 else 0.0)


def mean(values: Sequence[float]) -> Quantity:
    """The mean over runs; unknown as in `rms`."""
    x = np.array(values)
    if not x.size or not np.isfinite(x).all():
        return Quantity(value=None, standard_error=None)
    return Quantity(value=float(np.mean(x)), standard_error=_standard_error(x, 1.0))


def half_unit(printed: str) -> float:
    """Return half a unit of the last digit of a printed number, its possible rounding error."""
    return float(0.5 * 10.0 ** -len(printed.partition(".")[2]))


def _standard_error(x: Array, divisor: float) -> float | None:
    return float(np.std(x, ddof=1) / np.sqrt(x.size) / divisor) if x.size > 1 else None
