"""Whether a covariance is as large as the errors: the NEES over many short flights, bounded from both sides."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from onboard.arrays import Array

SURE = 0.99  # that an honest filter passes
CALM = 3.5  # times as large as the errors a standard deviation may be, where the truth is calmer than expected
CORRELATED = 1.5  # times as large as its expectation the mean NEES of one flight may be: its errors last


def nees(error: Array, P: Array) -> float:
    """Normalised estimation error squared, of an error (n,) with covariance P (n, n)."""
    return float(error @ np.linalg.solve(P, error))


def bounds(dof: int, flights: int) -> tuple[float, float]:
    """What the mean NEES over independent flights keeps within, if the filter is honest."""
    low, high = chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], dof * flights) / flights
    return float(low), float(high)


def assert_honest(found: Sequence[float], dof: int) -> None:
    """Assert that the mean NEES is what chi-square allows: neither over- nor underconfident."""
    low, high = bounds(dof, len(found))
    assert len(found) >= 20
    assert low < float(np.mean(found)) < high


def assert_neither_too_sure_nor_too_unsure(mean_nees: float, dof: int) -> None:
    """Assert of one flight, or of aircraft that fly more calmly than a filter expects, that errors are no larger
    than the covariance says, and its standard deviations at most `CALM` times as large. Whoever makes a filter
    sharper changes no number here."""
    assert dof / CALM**2 < mean_nees < CORRELATED * dof
