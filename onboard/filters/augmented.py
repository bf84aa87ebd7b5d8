"""Unscented filter with the noises in the state, for noise that is not simply added.

    belief = predict_augmented(belief, process, Q)             # process(points (k, n), noises (k, n_w)) -> (k, n)
    belief = update_augmented(belief, y, measure, R).belief    # measure(points (k, n), noises (k, n_v)) -> (k, m)

Varaprasad et al., section 3.1, after Julier. `weights` is a rule for any number of states, such as
`unscented.julier_weights`: the augmented state has L = n + n_w (+ n_v). `step_augmented` makes both halves from
one set of points (eqs 8-12), so that the measurement sees the process noise's own points; the two calls draw new
points in between, as eq 16 does. Noise covariances may be singular. Arrays are float64, with or
without leading batch axes.

With n + lambda = 3 the centre weighs 1 - L/3, and a strongly nonlinear model may leave no covariance; the rule
`lambda L: julier_weights(L, L)` has no negative weight.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside_first, check_spread
from onboard.filters.belief import ROWS, Belief, Indices, Method, Rows, Update, Weights, check_weights, mask, start
from onboard.filters.errors import FilterError, array_error, require_plain
from onboard.filters.kernels import augmented as kernels
from onboard.filters.kernels.calls import call
from onboard.filters.unscented import julier_weights, scaled_weights

NoisyRows = Callable[[Array, Array], Array]
Rule = Callable[[int], Weights]
NO_NOISE: Final = np.empty((0, 0))


def predict_augmented(
    belief: Belief, process: NoisyRows, Q: Array, weights: Rule = julier_weights, angular_states: Indices = ()
) -> Belief:
    """Time update with noise as an argument of the process.

    Parameters
    ----------
    belief
        Belief of n states.
    process
        Function of rows (k, n) and noises (k, n_w); returns rows (k, n).
    Q : (..., n_w, n_w)
        Covariance of the noises.
    weights
        Weights for a number of states.
    angular_states
        Indices of states that are angles, see `angles`.

    Returns
    -------
    Belief
        The predicted belief.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    n = belief.mean.shape[-1]
    points, rule = _spread(belief, Q, NO_NOISE, weights, angular_states)
    moved = _apply(process, points[..., :n], points[..., n:], "process")
    return _gathered(beside_first(moved, angular_states) if angular_states else moved, rule)


def update_augmented(
    belief: Belief,
    y: Array,
    measure: NoisyRows,
    R: Array,
    weights: Rule = julier_weights,
    angular: Indices = (),
    angular_states: Indices = (),
) -> Update:
    """Measurement update with noise as an argument of the measurement.

    Parameters
    ----------
    belief, weights, angular_states
        As in `predict_augmented`.
    y : (..., m)
        Measured values.
    measure
        Function of rows (k, n) and noises (k, n_v); returns rows (k, m).
    R : (..., n_v, n_v)
        Covariance of the noises.
    angular
        Components of y that are angles, whose differences wrap.

    Returns
    -------
    Update
        The posterior and the innovation.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    n = belief.mean.shape[-1]
    points, rule = _spread(belief, NO_NOISE, R, weights, angular_states)
    images = _apply(measure, points[..., :n], points[..., n:], "measure")
    return _correct(belief, points[..., :n], images, y, R, rule, angular)


def step_augmented(
    belief: Belief,
    process: NoisyRows,
    Q: Array,
    y: Array,
    measure: NoisyRows,
    R: Array,
    weights: Rule = julier_weights,
    angular: Indices = (),
    angular_states: Indices = (),
) -> Update:
    """Prediction and update from one set of 2L + 1 points, L = n + n_w + n_v (eqs 8-12).

    Parameters are those of `predict_augmented` and `update_augmented`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    n = belief.mean.shape[-1]
    points, rule = _spread(belief, Q, R, weights, angular_states)
    k = n + Q.shape[-1]
    moved = beside_first(_apply(process, points[..., :n], points[..., n:k], "process"), angular_states)
    images = _apply(measure, moved, points[..., k:], "measure")
    return _correct(_gathered(moved, rule), moved, images, y, R, rule, angular)


def _spread(belief: Belief, Q: Array, R: Array, weights: Rule, angular_states: Indices) -> tuple[Array, Weights]:
    """Return points (..., 2L+1, L) of state and noises (eq 9), and their weights.

    The first point is the mean.
    """
    try:
        L = belief.mean.shape[-1] + Q.shape[-1] + R.shape[-1]
        rule = weights(L)
    except (AttributeError, IndexError) as error:
        raise array_error(Q=Q, R=R) from error
    (points,) = call(kernels.spread, rule.spread, mean=belief.mean, covariance=belief.covariance, Q=Q, R=R)
    check_weights(rule, L)
    if angular_states:
        check_spread(points[..., : belief.mean.shape[-1]], angular_states)
    return points, rule


def _apply(model: NoisyRows, points: Array, noises: Array, name: str) -> Array:
    """Return images (..., 2L+1, m) of points with their noises. Raises FilterError."""
    n = points.shape[-1]
    rows, noise_rows = points.reshape(-1, n), noises.reshape(points[..., 0].size, noises.shape[-1])
    rows.setflags(False)  # type: ignore[call-arg]  # NumPy takes it
    noise_rows.setflags(False)  # type: ignore[call-arg]
    try:
        images = model(rows, noise_rows)
    except (ValueError, IndexError, TypeError) as error:
        error.add_note(ROWS)
        raise
    if images.__class__ is not np.ndarray:
        require_plain(**{name: images})
    if images.ndim != 2 or len(images) != len(rows) or (name == "process" and images.shape != rows.shape):
        raise FilterError(f"{name}: gave {images.shape} for rows {rows.shape}")
    return images.reshape(*points.shape[:-1], images.shape[1])


def _gathered(process: Array, rule: Weights) -> Belief:
    mean, covariance = call(kernels.gather, rule.covariance, rule.other, process=process)
    return Belief(mean, covariance)


def _correct(
    prior: Belief, points: Array, images: Array, y: Array, R: Array, rule: Weights, angular: tuple[int, ...]
) -> Update:
    if y.__class__ is not np.ndarray or y.ndim == 0:
        require_plain(y=y)
        raise array_error(y=y, points=points)
    angles = mask(angular, y.shape[-1])
    arrays = {
        "mean": prior.mean,
        "covariance": prior.covariance,
        "points": points,
        "measure": images,
        "y": y,
        "R": R,
    }
    mean, covariance, e, S, predicted, nis = call(kernels.correct, rule.covariance, rule.other, angles, **arrays)
    return Update(Belief(mean, covariance), e, S, predicted, nis if nis.ndim else float(nis))


# ------------------------------------------------------------------------------------- as methods


def additive(model: Rows, names: str = "model, noise") -> NoisyRows:
    """Return a model with additive noise as one that takes its noise as an argument.

    The result raises FilterError, with `names`.
    """

    def noisy(points: Array, noises: Array) -> Array:
        images = model(points)
        if images.__class__ is not np.ndarray:
            require_plain(**{names.partition(",")[0]: images})
        if images.shape != noises.shape:
            raise FilterError(f"{names}: gave {images.shape}, where noises are {noises.shape}")
        return images + noises

    return noisy


def _method(name: str, weights: Rule) -> Method:
    def predict_(state: Belief, process: Rows, Q: Array, angular_states: Indices = ()) -> Belief:
        return predict_augmented(state, additive(process, "process, Q"), Q, weights, angular_states)

    def update_(
        state: Belief, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
    ) -> Update:
        return update_augmented(state, y, additive(measure, "measure, R"), R, weights, angular, angular_states)

    return Method(name, start, predict_, update_, lambda state: state)


METHODS: Final[tuple[Method, ...]] = (
    _method("augmented", julier_weights),
    _method("augmented-scaled-1", lambda n: scaled_weights(n, 1.0, 2.0)),
)
