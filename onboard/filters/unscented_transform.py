"""Unscented transform: from a belief to points, which any model moves, and back.

    points = sigma_points(belief, weights)       # (2n+1, n)
    belief = recombine(model(points), weights, noise)

Julier; Oh & Johnson eqs 23-33. Arrays are float64. With a leading batch axis on mean and
covariance, all in one call.
"""

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import check_spread
from onboard.filters.belief import Belief, Weights, check_weights
from onboard.filters.errors import FilterError, array_error, raise_status, require_plain
from onboard.filters.kernels import unscented_transform as kernels
from onboard.filters.stepping import StepResult


def julier_weights(n: int, n_plus_lambda: float = 3.0) -> Weights:
    """Return weights with n + lambda given (eqs 23-25).

    3 matches the fourth moment of a Gaussian. For n > 3 the centre's weight is then negative: if a model is
    strongly curved over the belief, the centre subtracts more than the other points add, and the filter is
    overconfident (or finds no covariance). With `n_plus_lambda` of at least n no weight is negative.
    """
    if not n_plus_lambda > 0:
        raise FilterError("n_plus_lambda: must be positive")
    centre = 1.0 - n / n_plus_lambda
    return Weights(float(np.sqrt(n_plus_lambda)), centre, centre, 0.5 / n_plus_lambda)


def scaled_weights(n: int, alpha: float = 1e-3, beta: float = 2.0, kappa: float = 0.0) -> Weights:
    """Return van der Merwe's scaled weights, with lambda = alpha^2 (n + kappa) - n.

    beta = 2 suits a Gaussian.
    """
    if not (alpha > 0 and n + kappa > 0):
        raise FilterError("alpha and n + kappa: must be positive")
    total = alpha * alpha * (n + kappa)
    centre = 1.0 - n / total
    return Weights(float(np.sqrt(total)), centre, centre + 1.0 - alpha * alpha + beta, 0.5 / total)


def sigma_points(belief: Belief | StepResult, weights: Weights, angular_states: tuple[int, ...] = ()) -> Array:
    """Return sigma points (..., 2n+1, n), the mean first (eqs 29-30).

    `angular_states` is as in `angles`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, covariance = belief.mean, belief.covariance
    spread, w_mean, _, w = weights
    try:
        if mean.ndim == 1:
            n = len(mean)
            points = np.empty((2 * n + 1, n))
            status = kernels.spread(mean, covariance, spread, w_mean, w, points)
        else:
            check_weights(weights, mean.shape[-1])
            points, status = kernels.spread_batch(packed(mean), packed(covariance), spread)
    except (TypeError, AttributeError, IndexError) as error:
        raise array_error(mean=mean, covariance=covariance) from error
    if status:
        check_weights(weights, mean.shape[-1])
        raise_status(status, mean.shape[:-1], mean=mean, covariance=covariance)
    if angular_states:
        check_spread(points, angular_states)
    return points


def recombine(points: Array, weights: Weights, noise: Array) -> Belief:
    """Return the weighted mean and covariance of points, plus noise (eqs 32-33).

    Points are (..., 2n+1, n), the noise is (n, n).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    _, w_mean, w_cov, w = weights
    try:
        if noise.__class__ is not np.ndarray:
            require_plain(Q=noise)
        if points.ndim == 2:
            n = points.shape[1]
            out = np.empty((n + 1, n))
            mean, covariance = out[0], out[1:]
            status = kernels.gather(points, w_mean, w_cov, w, noise, out)
        else:
            mean, covariance, status = kernels.gather_batch(packed(points), w_mean, w_cov, w, batched(noise))
    except (TypeError, AttributeError) as error:
        raise array_error(process=points, Q=noise) from error
    if status:
        raise_status(status, points.shape[:-2], process=points, Q=noise)
    return Belief(mean, covariance)


def batched(noise: Array) -> Array:
    """Return noise (n, n) or (B, n, n) in the form for kernels of batches: (1 or B, n, n)."""
    return packed(noise if noise.ndim == 3 else noise[None])


def packed(array: Array) -> Array:
    """Return the array contiguous in memory, for kernels of batches."""
    return array if array.flags.c_contiguous else array.copy()
