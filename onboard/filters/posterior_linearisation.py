"""Iterated posterior linearisation (Garcia-Fernandez, Svensson, Morelande & Sarkka 2015).

The measurement is replaced by its best line over a belief, with the line's error as additional noise (statistical
linear regression). Over the prior this is the unscented update. But if the prior is wide and the measurement
sharp, the line should be best near the state: so it is fitted again over the posterior, and the same prior is
updated again. The measurement counts once: on a linear model any number of iterations is the Kalman filter.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import cubature, kalman, unscented
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, Weights, images_of, mask, start
from onboard.filters.errors import IMAGES_ERROR, POINTS_ERROR, FilterError
from onboard.filters.kernels import linearisation
from onboard.filters.kernels.calls import call, check_like
from onboard.filters.kernels.noise import noise_factor


def predict(
    belief: Belief, process: Rows, Q: Array, weights: Weights | None = None, angular_states: Indices = ()
) -> Belief:
    """Time update of the unscented filter.

    Parameters
    ----------
    belief, process, Q, angular_states
        As in `unscented.predict`.
    weights
        Sigma-point weights; None: those of the cubature filter.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if weights is None:
        return cubature.predict(belief, process, Q, angular_states)
    return unscented.predict(belief, process, Q, weights, angular_states)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    iterations: int = 4,
    weights: Weights | None = None,
    angular_states: tuple[int, ...] = (),
) -> Update:
    """Measurement update with repeated linearisations, the first over the prior.

    Innovation, its covariance and NIS are of the first linearisation: they are the prior's prediction, which a
    gate should test.

    Parameters
    ----------
    belief, y, measure, R, angular, considered, angular_states
        As in `unscented.update`.
    iterations
        Number of linearisations.
    weights
        Sigma-point weights; None: those of the cubature filter.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if iterations < 1:
        raise FilterError("iterations: must be at least 1")
    rule = weights or cubature.weights(belief.mean.shape[-1])
    arguments = y, measure, R, rule, angular, considered, angular_states
    first = _relinearised(belief, belief, *arguments)
    posterior = first.belief
    # an exact measurement leaves a posterior without width, over which no other line can be fitted
    exact = not np.diagonal(noise_factor("R", R), axis1=-2, axis2=-1).all()
    for _ in range(0 if exact else iterations - 1):
        posterior = _relinearised(belief, posterior, *arguments).belief
    return first._replace(belief=posterior)


def _relinearised(
    prior: Belief,
    about: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: Indices,
    considered: Indices,
    angular_states: Indices,
) -> Update:
    """Return the prior's update with the line fitted over another belief."""
    slope, value, rest = regression(about, measure, weights, y, angular, angular_states)
    # exactly `value` if `about` is the prior
    predicted = value + (slope @ (prior.mean - about.mean)[..., None])[..., 0]
    check_like(rest, R=R)
    return kalman.correct(prior, y, predicted, slope, R + rest, considered, angular)


def regression(
    belief: Belief,
    model: Rows,
    weights: Weights,
    y: Array | None = None,
    angular: Indices = (),
    angular_states: Indices = (),
) -> tuple[Array, Array, Array]:
    """Return the statistical linear regression of a model over a belief.

    With y the model is a measurement, without y a process, which errors name.

    Parameters
    ----------
    belief
        Belief of n states.
    model
        Function of rows (k, n); returns rows (k, m).
    weights
        Sigma-point weights.
    y : (..., m)
        Measured values.
    angular
        Values of the model that are angles.
    angular_states
        States that are angles.

    Returns
    -------
    tuple
        Slope (..., m, n), value at the mean (..., m), and covariance (..., m, m) of the residual.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    points = unscented.sigma_points(belief, weights, angular_states)
    images = images_of(model, points, y)
    options = (
        weights.covariance,
        weights.other,
        mask(angular, images.shape[-1]),
        POINTS_ERROR if y is None else IMAGES_ERROR,
    )
    slope, value, rest = call(linearisation.regress, *options, covariance=belief.covariance, model=images)
    return slope, value, rest


METHODS: Final = (
    Method(
        "posterior-linearisation",
        start,
        lambda state, process, Q, angular_states=(): predict(state, process, Q, None, angular_states),
        lambda state, y, measure, R, angular=(), angular_states=(): update(
            state, y, measure, R, angular, angular_states=angular_states
        ),
        lambda belief: belief,
    ),
)
