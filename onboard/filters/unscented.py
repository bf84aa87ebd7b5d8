"""The unscented Kalman filter, generic over models: Oh & Johnson eqs 19-42 (after Julier, and van der Merwe).

A model is a function over rows of states, so the filter never loops over sigma points:

    points = sigma_points(belief, weights)     # (2n+1, n)
    points = process(points)                   # (2n+1, n) -> (2n+1, n)
    belief = recombine(points, weights, Q)
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from onboard.geometry.rotations import Array


class Belief(NamedTuple):
    """What a filter believes: mean (n,) and covariance (n, n)."""

    mean: Array
    covariance: Array


class Weights(NamedTuple):
    """Sigma-point weights: `spread` is gamma, the distance in standard deviations; `mean` and `covariance`
    (2n+1,), the centre first."""

    spread: float
    mean: Array
    covariance: Array


class Update(NamedTuple):
    """A measurement update: the posterior, the innovation (m,), its covariance (m, m), the predicted
    measurement (m,) and the normalised innovation squared."""

    belief: Belief
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: float


class NotPositiveDefiniteError(ValueError):
    """A covariance has no Cholesky factor, so the step cannot be made; the belief passed in is untouched."""


@lru_cache(maxsize=32)
def julier_weights(n: int, n_plus_lambda: float = 3.0) -> Weights:
    """Weights with n + lambda given (eqs 23-25): 3 matches the fourth moment of a Gaussian; for n > 3 the
    centre weight is then negative."""
    w = np.full(2 * n + 1, 0.5 / n_plus_lambda)
    w[0] = 1.0 - n / n_plus_lambda
    w.flags.writeable = False  # cached, so shared
    return Weights(float(np.sqrt(n_plus_lambda)), w, w)


def factor(covariance: Array) -> Array:
    """Lower Cholesky factor (n, n) of a covariance.

    Raises NotPositiveDefiniteError, for NaN and infinity too (LAPACK lets those pass).
    """
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("the covariance is not positive definite") from error
    if not np.isfinite(lower).all():
        raise NotPositiveDefiniteError("the covariance is not finite")
    return np.asarray(lower)


def sigma_points(belief: Belief, weights: Weights) -> Array:
    """Sigma points (2n+1, n), the mean first (eqs 29-30).

    Raises NotPositiveDefiniteError.
    """
    offsets = weights.spread * factor(belief.covariance).T
    return np.concatenate([belief.mean[None], belief.mean + offsets, belief.mean - offsets])


def recombine(points: Array, weights: Weights, noise: Array) -> Belief:
    """Weighted mean and covariance of points (2n+1, n), plus noise (n, n) (eqs 32-33)."""
    mean = weights.mean @ points
    deviations = points - mean
    covariance = (weights.covariance[:, None] * deviations).T @ deviations + noise
    return Belief(mean, 0.5 * (covariance + covariance.T))


def predict(belief: Belief, process: Callable[[Array], Array], Q: Array, weights: Weights) -> Belief:
    """Time update (eqs 29-33). `process` maps rows (k, n) -> (k, n); `Q` (n, n) is that of the whole step.

    Raises NotPositiveDefiniteError.
    """
    return recombine(process(sigma_points(belief, weights)), weights, Q)


def update(
    belief: Belief,
    y: Array,
    measure: Callable[[Array], Array],
    R: Array,
    weights: Weights,
    subtract: Callable[[Array, Array], Array] = np.subtract,
    considered: tuple[int, ...] = (),
) -> Update:
    """Measurement update (eqs 34-42). `measure` maps rows (k, n) -> (k, m); `subtract(a, b)` is the difference
    of two measurements, to be given where angles wrap. States in `considered` keep their mean and variance: their
    uncertainty is carried in the others' covariance, but no measurement moves them (Schmidt 1966).

    Raises NotPositiveDefiniteError for the prior, and for an innovation covariance that cannot be inverted.
    """
    points = sigma_points(belief, weights)
    images = measure(points)
    # Means of angles are taken about the centre point's, so that a set across +-pi does not average to 0.
    offsets = subtract(images, images[0])
    mean_offset = weights.mean @ offsets
    predicted = images[0] + mean_offset
    deviations = offsets - mean_offset
    weighted = weights.covariance[:, None] * deviations
    S = weighted.T @ deviations + R
    cross = (points - belief.mean).T @ weighted
    innovation = subtract(y, predicted)
    whitened = np.linalg.solve(factor(S), np.column_stack([innovation, cross.T]))
    z, half = whitened[:, 0], whitened[:, 1:].T  # K S K^T = half half^T
    reduction = half @ half.T
    if considered:
        rows = np.array(considered)
        reduction[np.ix_(rows, rows)] = 0.0  # zero gain: P - K C^T - C K^T + K S K^T leaves these as they are
        half = half.copy()
        half[rows] = 0.0
    covariance = belief.covariance - reduction
    posterior = Belief(belief.mean + half @ z, 0.5 * (covariance + covariance.T))
    return Update(posterior, innovation, S, predicted, float(z @ z))
