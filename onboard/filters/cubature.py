"""The cubature Kalman filter (Arasaratnam & Haykin 2009): 2n points at sqrt(n) deviations, of weight 1/(2n) each.

That is exactly the unscented filter with kappa = 0, `julier_weights(n, n)`, whose centre has weight zero. Here the
model is called for 2n rows a filter, never for the centre: a value that is not finite there has no effect.
"""

from functools import lru_cache
from typing import Final

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.belief import Belief, Method, Rows, Update, Weights, images_of, mask, start
from onboard.filters.kernels import linearisation
from onboard.filters.kernels.calls import call


@lru_cache(maxsize=64)
def weights(n: int) -> Weights:
    """The third-degree spherical-radial rule for n states."""
    return Weights(float(n) ** 0.5, 0.0, 0.0, 0.5 / n)


def predict(belief: Belief, process: Rows, Q: Array) -> Belief:
    """Time update; `process` maps rows (k, n) -> (k, n), Q (..., n, n).

    Raises FilterError, NotPositiveDefiniteError.
    """
    rule = weights(belief.mean.shape[-1])
    points = unscented.sigma_points(belief, rule)
    return unscented.recombine(_images(process, points, (), None), rule, Q)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
) -> Update:
    """Measurement update; `measure` maps rows (k, n) -> (k, m), `angular` and `considered` as in
    `unscented.update`.

    Raises FilterError, NotPositiveDefiniteError.
    """
    rule = weights(belief.mean.shape[-1])
    points = unscented.sigma_points(belief, rule)
    images = _images(measure, points, angular, y)
    return unscented.correct(belief, points, images, y, R, rule, angular, considered)


def _images(model: Rows, points: Array, angular: tuple[int, ...], y: Array | None) -> Array:
    """Images (..., 2n+1, m) of points but the centre, in whose place stands the mean of the others'."""
    images = images_of(model, points[..., 1:, :], y)
    (completed,) = call(linearisation.with_centre, mask(angular, images.shape[-1]), model=images)
    return completed  # type: ignore[no-any-return]  # Numba's functions are not typed


METHODS: Final = (
    Method(
        "cubature",
        start,
        predict,
        update,
        lambda belief: belief,
        exempt=unscented.EXEMPT,
    ),
)
