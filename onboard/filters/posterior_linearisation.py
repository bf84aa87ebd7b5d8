"""Iterated posterior linearisation (Garcia-Fernandez, Svensson, Morelande & Sarkka 2015).

The measurement is replaced by its best line over a belief, with the line's error as additional noise
(statistical linear regression). Over the prior this is the unscented update. But where the prior is wide and
the measurement sharp, the line should be best near the state: so the line is fitted again over the posterior,
and the same prior is updated again. The measurement counts once: on a linear model any number of iterations is
the Kalman filter.
"""

from typing import Final

from onboard.arrays import Array
from onboard.filters import cubature, kalman, unscented
from onboard.filters.belief import (
    IMAGES,
    POINTS,
    Belief,
    FilterError,
    Method,
    Rows,
    Update,
    Weights,
    images_of,
    mask,
    start,
)
from onboard.filters.kernels import linearisation
from onboard.filters.kernels.calls import call, check_like


def predict(belief: Belief, process: Rows, Q: Array, weights: Weights | None = None) -> Belief:
    """Time update of the unscented filter; without `weights`, of the cubature filter.

    Raises FilterError, NotPositiveDefiniteError.
    """
    if weights is None:
        return cubature.predict(belief, process, Q)
    return unscented.predict(belief, process, Q, weights)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    iterations: int = 4,
    weights: Weights | None = None,
) -> Update:
    """Measurement update with `iterations` linearisations, the first over the prior; arguments as in
    `unscented.update`, the weights by default those of the cubature filter. Innovation, its covariance and NIS are
    of the first linearisation: they are the prior's prediction, which a gate should test.

    Raises FilterError, NotPositiveDefiniteError.
    """
    if iterations < 1:
        raise FilterError("iterations: must be at least 1")
    rule = weights or cubature.weights(belief.mean.shape[-1])
    first = _relinearised(belief, belief, y, measure, R, rule, angular, considered)
    posterior = first.belief
    for _ in range(iterations - 1):
        posterior = _relinearised(belief, posterior, y, measure, R, rule, angular, considered).belief
    return first._replace(belief=posterior)


def _relinearised(
    prior: Belief,
    about: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: tuple[int, ...],
    considered: tuple[int, ...],
) -> Update:
    """The prior's update with the line fitted over another belief."""
    slope, value, rest = regression(about, measure, weights, y, angular)
    # exactly `value` if `about` is the prior
    predicted = value + (slope @ (prior.mean - about.mean)[..., None])[..., 0]
    check_like(rest, R=R)
    return kalman.correct(prior, y, predicted, slope, R + rest, considered, angular)


def regression(
    belief: Belief, model: Rows, weights: Weights, y: Array | None = None, angular: tuple[int, ...] = ()
) -> tuple[Array, Array, Array]:
    """Statistical linear regression of a model over a belief: slope (..., m, n), value at the mean (..., m), and
    the covariance (..., m, m) of the residual. With y the model is a measurement, without y a process: errors name
    it so.

    Raises FilterError, NotPositiveDefiniteError.
    """
    points = unscented.sigma_points(belief, weights)
    images = images_of(model, points, y)
    options = weights.covariance, weights.other, mask(angular, images.shape[-1]), POINTS if y is None else IMAGES
    slope, value, rest = call(linearisation.regress, *options, covariance=belief.covariance, model=images)
    return slope, value, rest


METHODS: Final = (
    Method(
        "posterior-linearisation",
        start,
        predict,
        update,
        lambda belief: belief,
    ),
)
