"""Two-sided tests of covariances: the NEES over many short flights."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from onboard.arrays import Array

PASS_PROBABILITY = 0.99  # of an honest filter
MAX_CALM_RATIO = 3.5  # of standard deviation and error, if the truth is calmer than expected
MAX_NEES_RATIO = 1.5  # of the mean NEES of one flight to its expectation, as its errors are correlated


def nees(error: Array, P: Array) -> float:
    """Normalised estimation error squared, of an error (n,) with covariance P (n, n)."""
    return float(error @ np.linalg.solve(P, error))


def bounds(dof: int, flights: int) -> tuple[float, float]:
    """Return the bounds of the mean NEES over independent flights of an honest filter."""
    low, high = chi2.ppf([(1 - PASS_PROBABILITY) / 2, (1 + PASS_PROBABILITY) / 2], dof * flights) / flights
    return float(low), float(high)


def assert_honest(found: Sequence[float], dof: int) -> None:
    """Assert that the mean NEES is what chi-square allows: neither over- nor underconfident."""
    low, high = bounds(dof, len(found))
    assert len(found) >= 20
    assert low < float(np.mean(found)) < high


def assert_neither_too_sure_nor_too_unsure(mean_nees: float, dof: int) -> None:
    """Assert the consistency of one flight, or of aircraft that fly more calmly than expected.

    Errors must be no larger than the covariance says, and its standard deviations at most `MAX_CALM_RATIO` times
    as large as the errors. A sharper filter needs no change here.
    """
    assert dof / MAX_CALM_RATIO**2 < mean_nees < MAX_NEES_RATIO * dof
