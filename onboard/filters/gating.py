"""Chi-square gates, and the consistency figures NIS and NEES with their bounds."""

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.filters.errors import FilterError

MAX_ITERATIONS: Final = 100
QUANTILE_TOLERANCE: Final = 1e-14  # relative
SERIES_TOLERANCE: Final = 1e-15  # relative change by a series' last term


@lru_cache(maxsize=64)
def chi_square_threshold(probability: float, degrees: int) -> float:
    """Return a quantile of the chi-square distribution.

    By Newton's method from the approximation of Wilson and Hilferty. SciPy's takes longer to load than a flight
    may take to start.

    Parameters
    ----------
    probability
        Between 0 and 1, exclusive.
    degrees
        Degrees of freedom.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if not (degrees > 0 and 0.0 < probability < 1.0):
        raise FilterError(f"no quantile at {probability} with {degrees} degrees of freedom")
    a, few, tail = 0.5 * degrees, 2.0 / (9.0 * degrees), 1.0 - probability
    z = _normal_quantile(tail) if tail < probability else -_normal_quantile(probability)
    x = a * max(1.0 - few + z * math.sqrt(few), 0.05) ** 3
    low, high = 0.0, math.inf
    for _ in range(MAX_ITERATIONS):
        lower, upper = _gamma_probabilities(a, x)
        off = lower - probability if probability < tail else tail - upper
        low, high = (low, min(high, x)) if off > 0.0 else (max(low, x), high)
        after = x - off / math.exp((a - 1.0) * math.log(x) - x - math.lgamma(a))
        if not low < after < high:
            after = 0.5 * (low + high) if math.isfinite(high) else 2.0 * x
        if abs(after - x) <= QUANTILE_TOLERANCE * x:
            return 2.0 * after
        x = after
    return 2.0 * x


def _normal_quantile(tail: float) -> float:
    """Return the point beyond which lies `tail` < 0.5 of a normal distribution; within 5e-4.

    Abramowitz & Stegun, 26.2.23.
    """
    t = math.sqrt(-2.0 * math.log(tail))
    above, below = (0.010328, 0.802853, 2.515517), (0.001308, 0.189269, 1.432788, 1.0)
    return t - float(np.polyval(above, t) / np.polyval(below, t))


def _gamma_probabilities(a: float, x: float) -> tuple[float, float]:
    """Return the regularised incomplete gamma functions P(a, x) and Q(a, x) = 1 - P.

    The smaller one is by its series or its continued fraction, so that neither loses digits (Abramowitz & Stegun,
    6.5.29 and 6.5.31).
    """
    density = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        n, term, total = a, 1.0 / a, 1.0 / a
        while term > SERIES_TOLERANCE * total:
            n += 1.0
            term *= x / n
            total += term
        return total * density, 1.0 - total * density
    b = x + 1.0 - a  # Lentz's method
    c, d = math.inf, 1.0 / b
    fraction, k, change = d, 0, 0.0
    while abs(change - 1.0) > SERIES_TOLERANCE:
        k += 1
        step = k * (a - k)
        b += 2.0
        d = 1.0 / (b + step * d)
        c = b + step / c
        change = c * d
        fraction *= change
    return 1.0 - fraction * density, fraction * density


def mean_bounds(degrees: int, samples: int, probability: float = 0.95) -> tuple[float, float]:
    """Return the interval that contains a mean of chi-square variables with a probability.

    The variables are independent. Correlated samples (NEES of one run) scatter more: use the number of runs.

    Parameters
    ----------
    degrees
        Degrees of freedom of each variable.
    samples
        Number of variables.
    probability
        Probability of the interval.
    """
    if samples < 1:
        return (float("nan"), float("nan"))
    tail = (1 - probability) / 2
    low = chi_square_threshold(tail, degrees * samples) / samples
    return low, chi_square_threshold(1 - tail, degrees * samples) / samples


def normalised_squared(error: ArrayLike, covariance: ArrayLike) -> Array:
    """Return NEES (or NIS), error^T covariance^-1 error, (...,).

    It is infinite for a singular covariance, which claims to know something exactly.

    Parameters
    ----------
    error : (..., n)
        Errors.
    covariance : (..., n, n)
        Their covariances.
    """
    e, P = np.asarray(error, dtype=float), np.asarray(covariance, dtype=float)
    try:
        solved = np.linalg.solve(P, e) if e.ndim == 1 else np.linalg.solve(P, e[..., None])[..., 0]
    except np.linalg.LinAlgError:  # of one covariance: NumPy then solves none
        if P.ndim == 2 and e.ndim == 1:
            return np.asarray(np.inf)
        e, P = np.broadcast_arrays(e[..., None], P)
        return np.array([normalised_squared(one, C) for one, C in zip(e[..., 0], P, strict=True)])
    return np.asarray(np.add.reduce(e * solved, axis=-1))
