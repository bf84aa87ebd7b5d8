"""Errors of the filters, and the statuses of compiled kernels from which they are made."""

from typing import Any, Final, NoReturn

import numpy as np

from onboard.arrays import Array


class FilterError(ValueError):
    """An argument cannot be used; the message says which one and why.

    No argument has been changed.

    Attributes
    ----------
    member
        Which filter of a batch; None for one filter or for all.
    found
        The `Run` before the measurement that failed, from `runs.run`; None from any other function, and if the
        first measurement failed.
    """

    member: tuple[int, ...] | None = None
    found: Any = None


class NotPositiveDefiniteError(FilterError):
    """A covariance has no Cholesky factor (or is not finite), so the step cannot be made."""


class SpreadError(FilterError):
    """A belief is too wide for the angles that its sigma points must represent."""


# Maximum difference of a sigma point's angle from the centre's, rad. Beyond pi a wrapped difference has the wrong
# sign, and well before that the points do not represent the belief.
MAX_ANGLE_SPREAD: Final = 2.0
WEIGHT_SUM_TOLERANCE: Final = 1e-6  # relative

# Status of a compiled kernel: OK, or the error. A batch adds MEMBER_FACTOR times the member's index.
OK: Final = 0
MEAN_ERROR: Final = 1
COVARIANCE_ERROR: Final = 2
Q_NOT_FINITE_ERROR: Final = 3
POINTS_ERROR: Final = 4
IMAGES_ERROR: Final = 5
MEASUREMENT_ERROR: Final = 6
INNOVATION_ERROR: Final = 7
SHAPE_ERROR: Final = 8
MATRIX_ERROR: Final = 9
Q_INDEFINITE_ERROR: Final = 10
FACTOR_ERROR: Final = 11
DOWNDATE_ERROR: Final = 12
PREDICTED_ERROR: Final = 13
POSTERIOR_ERROR: Final = 14
R_NOT_FINITE_ERROR: Final = 15
R_INDEFINITE_ERROR: Final = 16
ANGLE_ERROR: Final = 17
NONLINEAR_PROCESS_ERROR: Final = 18
NONLINEAR_MEASURE_ERROR: Final = 19
WEIGHTS_ERROR: Final = 20
MEMBER_FACTOR: Final = 32

REASONS: Final = {
    MEAN_ERROR: "mean: not finite",
    COVARIANCE_ERROR: "covariance: not positive semi-definite, or not finite",
    Q_NOT_FINITE_ERROR: "Q: not finite",
    POINTS_ERROR: "process: gave states that are not finite",
    IMAGES_ERROR: "measure: gave measurements that are not finite",
    MEASUREMENT_ERROR: "y: not finite",
    INNOVATION_ERROR: "innovation covariance: not positive definite; R must be, where the prior knows y exactly",
    SHAPE_ERROR: "shapes do not fit: mean (n,), covariance and Q (n, n), process (k, n) to (k, n), y (m,), "
    "R (m, m), measure (k, n) to (k, m)",
    MATRIX_ERROR: "F or H: not finite",
    Q_INDEFINITE_ERROR: "Q: not positive semi-definite, so it is no covariance",
    FACTOR_ERROR: "factor: not lower triangular, with a negative number on its diagonal, or not finite",
    DOWNDATE_ERROR: "downdate: leaves a factor that is not positive definite",
    PREDICTED_ERROR: "predicted covariance: not positive semi-definite",
    POSTERIOR_ERROR: "covariance after the update: not positive semi-definite",
    R_NOT_FINITE_ERROR: "R: not finite",
    R_INDEFINITE_ERROR: "R: not positive semi-definite, so it is no covariance",
    NONLINEAR_PROCESS_ERROR: "process: is not affine, F x + a constant, which the Kalman filter takes it for; "
    "`extended`, `unscented` and others take any",
    NONLINEAR_MEASURE_ERROR: "measure: is not affine, H x + a constant, which the Kalman filter takes it for; "
    "`extended`, `unscented` and others take any",
    WEIGHTS_ERROR: "weights: are for another number of states",
    ANGLE_ERROR: f"angle: of sigma points, it is more than {MAX_ANGLE_SPREAD:g} rad from the centre's; beyond pi "
    "a wrapped difference turns its sign. The belief is too wide for these weights: `scaled_weights` with a small "
    "alpha, or the extended filter, stay near the centre",
}
MATRICES: Final = {
    COVARIANCE_ERROR,
    INNOVATION_ERROR,
    Q_INDEFINITE_ERROR,
    R_INDEFINITE_ERROR,
    FACTOR_ERROR,
    DOWNDATE_ERROR,
    PREDICTED_ERROR,
    POSTERIOR_ERROR,
}


def raise_status(status: int, lead: tuple[int, ...] = (), **arrays: Any) -> NoReturn:
    """Raise `status_error`."""
    raise status_error(status, lead, **arrays)


def status_error(status: int, lead: tuple[int, ...] = (), **arrays: Any) -> FilterError:
    """Return the error for a kernel's status that is not OK, of a batch of shape `lead`.

    `arrays` are those whose shapes may not fit.
    """
    member, reason = divmod(status, MEMBER_FACTOR)
    if reason == SHAPE_ERROR and arrays:
        return shape_error(**arrays)
    kind = (
        NotPositiveDefiniteError if reason in MATRICES else SpreadError if reason == ANGLE_ERROR else FilterError
    )
    if not lead:
        return kind(REASONS[reason])
    at = tuple(int(i) for i in np.unravel_index(member, lead))
    error = kind(f"filter {'.'.join(str(i) for i in at)} of the batch: {REASONS[reason]}")
    error.member = at
    return error


def check_members(bad: Any, reason: int) -> None:
    """Raise `status_error` for the first of a batch, bad (...,), that has this reason."""
    if bad.any():
        raise status_error(reason + MEMBER_FACTOR * int(np.flatnonzero(bad)[0]), bad.shape)


# Number of axes of an argument for one filter; axes before these are the batch.
AXES: Final = {"mean": 1, "y": 1, "predicted": 1} | dict.fromkeys(
    ("covariance", "factor", "F", "H", "Q", "R", "K", "U", "points", "process", "measure", "model"), 2
)
SHARED: Final = {"F", "H", "Q", "R"}  # one may serve a whole batch


def is_plain(array: Any) -> bool:
    """Return whether every number of an array counts.

    A masked array's masked numbers would count as measured, and a matrix has another product.
    """
    return isinstance(array, np.ndarray) and not isinstance(array, np.ma.MaskedArray | np.matrix)


def array_error(**arrays: Any) -> FilterError:
    """Return the error for arguments that no kernel accepts.

    They are not arrays, not of float64, or of different rank.
    """
    for name in ("angular", "considered"):
        if not isinstance(chosen := arrays.pop(name, ()), tuple):
            return FilterError(f"{name}: must be a tuple of indices, such as (0,), not {chosen!r}")
    for name, array in arrays.items():
        if not is_plain(array):
            return FilterError(f"{name}: must be a NumPy array{PLAIN}, not {type(array).__name__}")
        if array.dtype != np.float64:
            return FilterError(f"{name}: must be float64, not {array.dtype}")
    return shape_error(**arrays)


def require_plain(**arrays: Any) -> None:
    """Raise FilterError for an argument that is no array, or a masked one, or a matrix."""
    for name, array in arrays.items():
        if array.__class__ is not np.ndarray and not is_plain(array):
            raise array_error(**{name: array})


PLAIN: Final = (
    " (no masked array, no matrix: what is not measured is left out of y, its rows out of measure and R)"
)


def shape_error(**arrays: Array) -> FilterError:
    """Return the error for shapes that do not fit.

    It begins with an argument with a wrong number of axes, if there is one: the belief or its points define the
    batch.
    """
    described = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    depths = {name: array.ndim - AXES[name] for name, array in arrays.items() if name in AXES}
    batch = next((depths[name] for name in ("mean", "points", "covariance", "factor") if name in depths), 0)
    for name, depth in depths.items():
        if depth < 0 or (depth != batch and name not in SHARED):
            one = ("(n,)" if name == "mean" else "(m,)") if AXES[name] == 1 else "a matrix"
            before = "" if batch < 1 else f", with the batch's {batch} axes before"
            return FilterError(f"arrays must agree in axes: {name} must be {one}{before}; shapes are {described}")
    points = arrays.get("points")
    for name in ("process", "measure"):
        if points is not None and name in arrays and arrays[name].shape[:-1] != points.shape[:-1]:
            shapes = f"{arrays[name].shape} for points {points.shape}"
            return FilterError(f"{name}: gave {shapes}; shapes do not fit, a row of states gives a row")
    return FilterError(f"shapes do not fit: {described}")
