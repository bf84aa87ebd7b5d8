"""Linear Kalman filter, with the covariance in Joseph's form.

    belief = predict(belief, F, Q)                # an outage is this alone, as often as it lasts
    belief = update(belief, y, H, R).belief

Kalman 1960; De Vivo et al. table 1 and eq 15. Arrays are float64; leading axes broadcast, so
one call advances a batch of filters. A covariance may be singular (a state known exactly), not indefinite.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, images_of, mask, start
from onboard.filters.errors import FilterError, require_plain
from onboard.filters.kernels import linear as kernels
from onboard.filters.kernels.calls import call, masks


def predict(belief: Belief, F: Array, Q: Array) -> Belief:
    """Time update: F m and F P F^T + Q.

    Parameters
    ----------
    belief
        Belief of n states.
    F, Q : (..., n, n)
        Transition, and covariance of the process noise.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    (covariance,) = call(kernels.propagate, covariance=belief.covariance, F=F, Q=Q)
    return Belief(_image(F, belief.mean, "F"), covariance)


def update(
    belief: Belief,
    y: Array,
    H: Array,
    R: Array,
    considered: tuple[int, ...] = (),
    angular: tuple[int, ...] = (),
) -> Update:
    """Measurement update.

    Parameters
    ----------
    belief
        Belief of n states.
    y : (..., m)
        Measured values.
    H : (..., m, n)
        Measurement matrix.
    R : (..., m, m)
        Covariance of the measurement noise.
    considered
        Indices of states that keep their mean and variance; their uncertainty is carried in the others' covariance
        (Schmidt 1966).
    angular
        Components of y that are angles and wrap.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    return correct(belief, y, _image(H, belief.mean, "H"), H, R, considered, angular)


def correct(
    belief: Belief,
    y: Array,
    predicted: Array,
    H: Array,
    R: Array,
    considered: tuple[int, ...] = (),
    angular: tuple[int, ...] = (),
) -> Update:
    """Measurement update with the predicted measurement (..., m) given.

    It need not be H times the mean. Other parameters are those of `update`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, covariance, innovation, S, nis = call(
        kernels.correct,
        *masks(y, angular, belief.mean, considered),
        mean=belief.mean,
        covariance=belief.covariance,
        H=H,
        predicted=predicted,
        y=y,
        R=R,
    )
    return Update(Belief(mean, covariance), innovation, S, predicted, nis if nis.ndim else float(nis))


def affine(model: Rows, mean: Array, y: Array | None = None, angular: Indices = ()) -> tuple[Array, Array]:
    """Return the matrix (..., m, n) of an affine function, and its value at the mean (..., m).

    They are exact except for rounding, from the function's values at the origin, on the axes and at the mean;
    `angular` are the values that wrap.

    Raises
    ------
    FilterError
        If an argument cannot be used, or if the function is not affine.
    """
    (corners,) = call(kernels.corners, mean=mean)
    images = images_of(model, corners, y)
    options = mask(angular, images.shape[-1]), y is not None
    matrix, value = call(kernels.affine, *options, points=corners, model=images)
    return matrix, value


def _image(matrix: Array, mean: Array, name: str) -> Array:
    if type(matrix) is not np.ndarray or type(mean) is not np.ndarray:
        require_plain(**{name: matrix, "mean": mean})
    try:
        image: Array = np.matvec(matrix, mean) if hasattr(np, "matvec") else (matrix @ mean[..., None])[..., 0]
    except (ValueError, TypeError) as error:
        shapes = f"{name} {np.shape(matrix)}, mean {np.shape(mean)}"
        raise FilterError(f"shapes do not fit: {shapes}") from error
    if not np.isfinite(image).all():
        raise FilterError(f"{name} or mean: not finite")
    return image


def _predict(belief: Belief, process: Rows, Q: Array, angular_states: Indices = ()) -> Belief:
    F, mean = affine(process, belief.mean, None, angular_states)
    (covariance,) = call(kernels.propagate, covariance=belief.covariance, F=F, Q=Q)
    return Belief(mean, covariance)


def _update(belief: Belief, y: Array, measure: Rows, R: Array, angular: Indices = (), _: Indices = ()) -> Update:
    H, predicted = affine(measure, belief.mean, y, angular)
    return correct(belief, y, predicted, H, R, (), angular)


METHODS: Final = (Method("kalman", start, _predict, _update, lambda belief: belief),)
