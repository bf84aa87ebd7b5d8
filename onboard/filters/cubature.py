"""Cubature Kalman filter (Arasaratnam & Haykin 2009).

It has 2n points at sqrt(n) deviations, of weight 1/(2n) each, and equals the unscented filter with kappa = 0,
`julier_weights(n, n)`, whose centre has weight zero. Here the model is called for 2n rows a filter, and not for
the centre: a value that is not finite there has no effect. If some of the model's values are angles it is called
for the centre, too, because without one the mean of two angles a radian and more to each side is ambiguous.
"""

from functools import lru_cache
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.angles import beside_first
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, Weights, images_of, mask, start
from onboard.filters.kernels import images as kernels
from onboard.filters.kernels.calls import call


@lru_cache(maxsize=64)
def weights(n: int) -> Weights:
    """Return the third-degree spherical-radial rule for n states."""
    return Weights(float(n) ** 0.5, 0.0, 0.0, 0.5 / n)


def predict(belief: Belief, process: Rows, Q: Array, angular_states: Indices = ()) -> Belief:
    """Time update.

    Parameters
    ----------
    belief
        Belief of n states.
    process
        Function of rows (k, n); returns rows (k, n).
    Q : (..., n, n)
        Covariance of the process noise.
    angular_states
        Indices of states that are angles, see `angles`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    rule = weights(belief.mean.shape[-1])
    points = unscented.sigma_points(belief, rule, angular_states)
    moved = beside_first(_images(process, points, angular_states, None), angular_states)
    return unscented.recombine(moved, rule, Q)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    angular: Indices = (),
    considered: Indices = (),
    angular_states: Indices = (),
) -> Update:
    """Measurement update.

    Parameters are those of `unscented.update`, without the weights.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    rule = weights(belief.mean.shape[-1])
    points = unscented.sigma_points(belief, rule, angular_states)
    images = _images(measure, points, angular, y)
    return unscented.correct(belief, points, images, y, R, rule, angular, considered)


def _images(model: Rows, points: Array, angular: Indices, y: Array | None) -> Array:
    """Return images (..., 2n+1, m) of points.

    The centre's is the mean of the others, unless there are angles.
    """
    if angular:
        images = images_of(model, points, y)
        if np.isfinite(images[..., 0, :]).all():
            return images
        images = images[..., 1:, :]
    else:
        images = images_of(model, points[..., 1:, :], y)
    (completed,) = call(kernels.with_centre, mask(angular, images.shape[-1]), model=images)
    return completed  # type: ignore[no-any-return]  # Numba's functions are not typed


METHODS: Final = (
    Method(
        "cubature",
        start,
        predict,
        lambda state, y, measure, R, angular=(), angular_states=(): update(
            state, y, measure, R, angular, (), angular_states
        ),
        lambda belief: belief,
    ),
)
