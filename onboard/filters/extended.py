"""Extended Kalman filter: the Kalman filter on the tangent at the mean.

Jacobians are functions over rows, (k, n) -> (k, n or m, n), or come from central differences: one call of the
model with the mean and 2n points about it. Covariances are symmetric to the last bit. Batches as in `kalman`.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import kalman
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, images_of, mask, over_rows, start
from onboard.filters.errors import IMAGES_ERROR, POINTS_ERROR, FilterError
from onboard.filters.kernels import linear, linearisation
from onboard.filters.kernels.calls import call

Jacobian = Callable[[Array], Array]


def predict(
    belief: Belief, process: Rows, Q: Array, jacobian: Jacobian | None = None, angular_states: Indices = ()
) -> Belief:
    """Time update: f(m) and F P F^T + Q, with the Jacobian F of `process` at the mean.

    Parameters
    ----------
    belief, process, Q, angular_states
        As in `unscented.predict`.
    jacobian
        Jacobian of `process` over rows, (k, n) -> (k, n, n); None: central differences.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, F = tangent(belief, process, jacobian, None, angular_states)
    if not np.isfinite(mean).all():
        raise FilterError("process: gave states that are not finite")
    (covariance,) = call(linear.propagate, covariance=belief.covariance, F=F, Q=Q)
    return Belief(mean, covariance)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    jacobian: Jacobian | None = None,
) -> Update:
    """Measurement update by the Jacobian of `measure` at the mean, in Joseph's form.

    Parameters
    ----------
    belief, y, measure, R, angular, considered
        As in `unscented.update`.
    jacobian
        Jacobian of `measure` over rows, (k, n) -> (k, m, n); None: central differences.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    predicted, H = tangent(belief, measure, jacobian, y, angular)
    return kalman.correct(belief, y, predicted, H, R, considered, angular)


def tangent(
    belief: Belief,
    model: Rows,
    jacobian: Jacobian | None = None,
    y: Array | None = None,
    angular: tuple[int, ...] = (),
) -> tuple[Array, Array]:
    """Return a model's value (..., m) and Jacobian (..., m, n) at the mean.

    Without `jacobian`, it is by central differences, with steps of eps^(1/4) of the belief's standard deviations.
    With y the model is a measurement, without y a process, which errors name.

    Raises
    ------
    FilterError
        If an argument cannot be used.
    NotPositiveDefiniteError
        For a covariance with a negative diagonal.
    """
    if jacobian is not None:
        *lead, n = belief.mean.shape
        value = images_of(model, belief.mean[..., None, :], y)[..., 0, :]
        slopes = over_rows(jacobian, belief.mean.reshape(-1, n), y)
        wanted = (belief.mean.size // n, value.shape[-1], n)
        if slopes.shape != wanted:
            raise FilterError(f"jacobian: gave {slopes.shape}, must be {wanted}: for each row a matrix (m, n)")
        return value, slopes.reshape(*lead, *wanted[1:])
    (points,) = call(linearisation.stencil, mean=belief.mean, covariance=belief.covariance)
    fault = POINTS_ERROR if y is None else IMAGES_ERROR
    images = images_of(model, points, y)
    (slope,) = call(linearisation.slopes, mask(angular, images.shape[-1]), fault, points=points, model=images)
    return images[..., 0, :], slope


def complex_step(model: Rows, step: float = 1e-20) -> Jacobian:
    """Return the Jacobian of a model that accepts complex rows, to the last digits.

    It is the imaginary part of the model's values at `step` times i beside each state, over the step. No
    difference cancels. It is right for a model of sums, products, powers and functions such as np.sin and np.exp;
    not of np.abs, np.hypot, np.arctan2 or comparisons, which refuse complex numbers or drop their imaginary part.
    The returned function raises FilterError if the model gives real numbers.

    References
    ----------
    W. Squire and G. Trapp, Using complex variables to estimate derivatives of real functions, 1998.
    """

    def jacobian(rows: Array) -> Array:
        k, n = rows.shape
        beside: Any = rows[:, None, :] + 1j * step * np.eye(n)  # (k, n, n): one state moved in each
        images = np.asarray(model(beside.reshape(-1, n)))
        if not np.iscomplexobj(images) or images.shape[:1] != (k * n,):
            raise FilterError(f"model: gave {images.dtype} {images.shape} for complex rows {(k * n, n)}")
        return np.swapaxes(images.imag.reshape(k, n, -1), 1, 2) / step

    return jacobian


def method(process_jacobian: Jacobian | None = None, measure_jacobian: Jacobian | None = None) -> Method:
    """Return this filter as a `Method`, with given Jacobians or without."""
    return Method(
        "extended",
        start,
        lambda state, process, Q, angular_states=(): predict(state, process, Q, process_jacobian, angular_states),
        lambda state, y, measure, R, angular=(), _=(): update(
            state, y, measure, R, angular, jacobian=measure_jacobian
        ),
        lambda belief: belief,
    )


METHODS: Final = (method(),)
