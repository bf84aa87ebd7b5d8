"""Chi-square gates, and the consistency figures NIS and NEES with their bounds."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array


@lru_cache(maxsize=64)
def chi_square_threshold(probability: float, degrees: int) -> float:
    """The quantile of the chi-square distribution with `degrees` of freedom at `probability`."""
    from scipy.special import gammaincinv  # noqa: PLC0415 - a third of a second, which replay --help does not need

    return float(2.0 * gammaincinv(degrees / 2.0, probability))


def mean_bounds(degrees: int, samples: int, probability: float = 0.95) -> tuple[float, float]:
    """The interval that holds the mean of `samples` independent chi-square variables of `degrees` with
    `probability`. Correlated samples (NEES of one run) scatter more: use the number of runs."""
    if samples < 1:
        return (float("nan"), float("nan"))
    tail = (1 - probability) / 2
    low = chi_square_threshold(tail, degrees * samples) / samples
    return low, chi_square_threshold(1 - tail, degrees * samples) / samples


def normalised_squared(error: ArrayLike, covariance: ArrayLike) -> Array:
    """NEES (or NIS): error^T covariance^-1 error, for error (..., n) and covariance (..., n, n). Infinite where a
    covariance is singular, which claims to know something exactly."""
    e, P = np.asarray(error, dtype=float), np.asarray(covariance, dtype=float)
    try:
        solved = np.linalg.solve(P, e[..., None])[..., 0]
    except np.linalg.LinAlgError:  # of one covariance: NumPy then solves none
        if P.ndim == 2 and e.ndim == 1:
            return np.asarray(np.inf)
        e, P = np.broadcast_arrays(e[..., None], P)
        return np.array([normalised_squared(one, C) for one, C in zip(e[..., 0], P, strict=True)])
    return np.asarray(np.sum(e * solved, axis=-1))
