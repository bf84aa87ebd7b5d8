"""Unscented Kalman filter, generic over models: Oh & Johnson eqs 19-42.

    points = spread(belief)            # (2n+1, n)
    points = process(points)           # (2n+1, n) -> (2n+1, n): the model, any function over rows
    belief = gather(points) + Q

After Julier, and van der Merwe. Arrays are float64. With a leading batch axis B on mean and
covariance (and on y), B filters advance in one call; the model then gets the rows of all of them, (B (2n+1), n),
each filter's together.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import stepping
from onboard.filters.angles import beside_first
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, Weights, mask, over_rows, start
from onboard.filters.definite import factor
from onboard.filters.errors import array_error, require_plain, status_error
from onboard.filters.kernels import unscented as kernels
from onboard.filters.stepping import Rule
from onboard.filters.unscented_transform import (
    batched,
    julier_weights,
    packed,
    recombine,
    scaled_weights,
    sigma_points,
)

__all__ = [
    "METHODS",
    "correct",
    "factor",
    "julier_weights",
    "method",
    "predict",
    "recombine",
    "rule",
    "scaled_weights",
    "sigma_points",
    "step",
    "update",
]


def _keep_pages() -> None:
    """Let a large batch keep its memory from step to step.

    The C library (glibc) returns free memory at the top of the heap when it is more than twice the largest block
    ever freed. A batch of 500 would take it again in each step, page by page, for a tenth of its time. Freeing one
    block of 8 MB, never touched, prevents that.
    """
    np.empty(8 << 20, np.uint8)


_keep_pages()


def rule(
    weights: Weights,
    n: int,
    m: int,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    angular_states: tuple[int, ...] = (),
) -> Rule:
    """Return the rule of this filter for `step`.

    Parameters
    ----------
    n, m
        Numbers of states and of measured components.
    weights, angular, considered, angular_states
        As in `update`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    return stepping.rule(weights, n, m, angular, considered, KERNELS, angular_states)


KERNELS: Final = stepping.Kernels(
    sigma_points, kernels.redraw, kernels.correct_and_redraw, factored=False, scratch_size=kernels.scratch_size
)
step: Final = stepping.step  # of this filter, by its `rule`


def predict(
    belief: Belief, process: Rows, Q: Array, weights: Weights, angular_states: tuple[int, ...] = ()
) -> Belief:
    """Time update (eqs 29-33).

    Parameters
    ----------
    belief
        Belief of n states.
    process
        Function of rows (k, n); returns rows (k, n).
    Q : (n, n)
        Covariance of the process noise of the whole step.
    weights
        Sigma-point weights, such as `julier_weights(n)`.
    angular_states
        Indices of states that are angles, whose differences wrap (`angles`).

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
    moved = over_rows(process, sigma_points(belief, weights, angular_states))
    return recombine(beside_first(moved, angular_states) if angular_states else moved, weights, Q)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    angular_states: tuple[int, ...] = (),
) -> Update:
    """Measurement update (eqs 34-42).

    Parameters
    ----------
    belief
        Belief of n states.
    y : (..., m)
        Measured values.
    measure
        Function of rows (k, n); returns rows (k, m).
    R : (m, m)
        Covariance of the measurement noise.
    weights
        Sigma-point weights, such as `julier_weights(n)`.
    angular
        Components of y that are angles, whose differences wrap.
    considered
        Indices of states that keep their mean and variance: no measurement moves them, but their uncertainty is
        carried in the others' covariance (Schmidt 1966).
    angular_states
        Indices of states that are angles, whose differences wrap (`angles`).

    Returns
    -------
    Update
        The posterior, the innovation and its NIS.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If the prior or the innovation has a covariance that is not positive definite.
    """
    points = sigma_points(belief, weights, angular_states)
    images = over_rows(measure, points, y)
    return correct(belief, points, images, y, R, weights, angular, considered)


def correct(
    belief: Belief,
    points: Array,
    images: Array,
    y: Array,
    R: Array,
    weights: Weights,
    angular: tuple[int, ...],
    considered: tuple[int, ...],
) -> Update:
    """Return the second half of `update`.

    It starts from sigma points (..., 2n+1, n) and their images (..., 2n+1, m).
    """
    if not (y.__class__ is R.__class__ is np.ndarray):
        require_plain(y=y, R=R)
    try:
        n, m = points.shape[-1], y.shape[-1]
        masks = mask(angular, m), mask(considered, n)
        if points.ndim == 2:
            posterior, found = np.empty((n + 1, n)), np.empty((m + 2, m))
            arrays = points, images, belief.covariance, y, R
            status, nis = kernels.correct(*arrays, *weights[2:], *masks, posterior, found)
            if not status:
                return Update(Belief(posterior[0], posterior[1:]), found[0], found[2:], found[1], nis)
        else:
            arrays = packed(points), images, packed(belief.covariance), packed(y), batched(R)
            *after, innovation, S, predicted, nis, status = kernels.correct_batch(*arrays, *weights[2:], *masks)
            if not status:
                return Update(Belief(*after), innovation, S, predicted, nis)
    except (TypeError, AttributeError, IndexError) as error:
        chosen: Any = {"angular": angular, "considered": considered}
        raise array_error(points=points, measure=images, y=y, R=R, **chosen) from error
    raise status_error(status, points.shape[:-2], points=points, measure=images, y=y, R=R)


# ------------------------------------------------------------------------------------- as methods


def method(name: str, weights: Callable[[int], Weights], considered: tuple[int, ...] = (), **more: Any) -> Method:
    """Return the filter with given weights as a `Method`."""

    def predict_(state: Belief, process: Rows, Q: Array, angular_states: Indices = ()) -> Belief:
        return predict(state, process, Q, weights(state.mean.shape[-1]), angular_states)

    def update_(
        state: Belief, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
    ) -> Update:
        return update(state, y, measure, R, weights(state.mean.shape[-1]), angular, considered, angular_states)

    return Method(name, start, predict_, update_, lambda state: state, **more)


METHODS: Final = (
    method("unscented", julier_weights),
    method("unscented-scaled-1", lambda n: scaled_weights(n, 1.0, 2.0)),
    method("unscented-scaled-0.1", lambda n: scaled_weights(n, 0.1, 2.0)),
    method(
        "unscented-considered",
        julier_weights,
        (0,),
        exempt={"kalman": "a considered state is not moved by measurements, which is not optimal (Schmidt 1966)"},
    ),
)
