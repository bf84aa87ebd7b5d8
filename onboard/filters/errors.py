"""What a filter refuses: the statuses of compiled kernels, and the errors that say which argument and why."""

from typing import Any, Final, NoReturn

import numpy as np

from onboard.arrays import Array


class FilterError(ValueError):
    """An argument cannot be used; the message says which one and why. Nothing passed in has been changed.

    `member`: which filter of a batch, None for one filter or for all. `found`: what `runs.run` has found before
    the measurement that failed, a `Run`; None from any other function, and where the first measurement failed.
    """

    member: tuple[int, ...] | None = None
    found: Any = None


class NotPositiveDefiniteError(FilterError):
    """A covariance has no Cholesky factor (or is not finite), so the step cannot be made."""


class SpreadError(FilterError):
    """A belief is too wide for the angles that its sigma points are to show."""


# The farthest that a sigma point's angle may be from the centre's, rad. Beyond pi a wrapped difference has the
# wrong sign, and well before that the points are no picture of the belief.
FARTHEST: Final = 2.0
NEAR: Final = 1e-6  # relative, of a sum of weights

# The status that a compiled kernel returns: OK, or what is wrong. A batch adds MEMBER times the member's index.
OK: Final = 0
MEAN: Final = 1
COVARIANCE: Final = 2
Q_NOT_FINITE: Final = 3
POINTS: Final = 4
IMAGES: Final = 5
MEASUREMENT: Final = 6
INNOVATION: Final = 7
SHAPE: Final = 8
MATRIX: Final = 9
Q_INDEFINITE: Final = 10
FACTOR: Final = 11
DOWNDATE: Final = 12
PREDICTED: Final = 13
POSTERIOR: Final = 14
R_NOT_FINITE: Final = 15
R_INDEFINITE: Final = 16
ANGLE: Final = 17
BENT_PROCESS: Final = 18
BENT_MEASURE: Final = 19
WEIGHTS: Final = 20
MEMBER: Final = 32

REASONS: Final = {
    MEAN: "mean: not finite",
    COVARIANCE: "covariance: not positive semi-definite, or not finite",
    Q_NOT_FINITE: "Q: not finite",
    POINTS: "process: gave states that are not finite",
    IMAGES: "measure: gave measurements that are not finite",
    MEASUREMENT: "y: not finite",
    INNOVATION: "innovation covariance: not positive definite; R must be, where the prior knows y exactly",
    SHAPE: "shapes do not fit: mean (n,), covariance and Q (n, n), process (k, n) to (k, n), y (m,), R (m, m), "
    "measure (k, n) to (k, m)",
    MATRIX: "F or H: not finite",
    Q_INDEFINITE: "Q: not positive semi-definite, so it is no covariance",
    FACTOR: "factor: not lower triangular, with a negative number on its diagonal, or not finite",
    DOWNDATE: "downdate: leaves a factor that is not positive definite",
    PREDICTED: "predicted covariance: not positive semi-definite",
    POSTERIOR: "covariance after the update: not positive semi-definite",
    R_NOT_FINITE: "R: not finite",
    R_INDEFINITE: "R: not positive semi-definite, so it is no covariance",
    BENT_PROCESS: "process: is not affine, F x + a constant, which the Kalman filter takes it for; `extended`, "
    "`unscented` and others take any",
    BENT_MEASURE: "measure: is not affine, H x + a constant, which the Kalman filter takes it for; `extended`, "
    "`unscented` and others take any",
    WEIGHTS: "weights: are for another number of states",
    ANGLE: f"angle: of sigma points, it is more than {FARTHEST:g} rad from the centre's; beyond pi a wrapped "
    "difference turns its sign. The belief is too wide for these weights: `scaled_weights` with a small alpha, or "
    "the extended filter, stay near the centre",
}
MATRICES: Final = {COVARIANCE, INNOVATION, Q_INDEFINITE, R_INDEFINITE, FACTOR, DOWNDATE, PREDICTED, POSTERIOR}


def raise_status(status: int, lead: tuple[int, ...] = (), **arrays: Any) -> NoReturn:
    """Raise `status_error`."""
    raise status_error(status, lead, **arrays)


def status_error(status: int, lead: tuple[int, ...] = (), **arrays: Any) -> FilterError:
    """The error for a kernel's status that is not OK, of a batch of shape `lead`; `arrays` are those whose shapes
    may not fit."""
    member, reason = divmod(status, MEMBER)
    if reason == SHAPE and arrays:
        return shape_error(**arrays)
    kind = NotPositiveDefiniteError if reason in MATRICES else SpreadError if reason == ANGLE else FilterError
    if not lead:
        return kind(REASONS[reason])
    at = tuple(int(i) for i in np.unravel_index(member, lead))
    error = kind(f"filter {'.'.join(str(i) for i in at)} of the batch: {REASONS[reason]}")
    error.member = at
    return error


def check_members(bad: Any, reason: int) -> None:
    """Raises `status_error` for the first of a batch, bad (...,), that has this reason."""
    if bad.any():
        raise status_error(reason + MEMBER * int(np.flatnonzero(bad)[0]), bad.shape)


# The axes that an argument has for one filter; axes before these are the batch.
AXES: Final = {"mean": 1, "y": 1, "predicted": 1} | dict.fromkeys(
    ("covariance", "factor", "F", "H", "Q", "R", "K", "U", "points", "process", "measure", "model"), 2
)
SHARED: Final = {"F", "H", "Q", "R"}  # one may be for a whole batch


def is_plain(array: Any) -> bool:
    """Whether it is an array of which every number counts: no masked array, whose masked numbers would be taken
    for measured, and no matrix, whose product is another one."""
    return isinstance(array, np.ndarray) and not isinstance(array, np.ma.MaskedArray | np.matrix)


def array_error(**arrays: Any) -> FilterError:
    """The error for arguments that no kernel takes: not arrays, not of floating point, or of different precision
    or rank."""
    for name in ("angular", "considered"):
        if not isinstance(chosen := arrays.pop(name, ()), tuple):
            return FilterError(f"{name}: must be a tuple of indices, such as (0,), not {chosen!r}")
    for name, array in arrays.items():
        if not is_plain(array):
            return FilterError(f"{name}: must be a NumPy array{PLAIN}, not {type(array).__name__}")
        if array.dtype not in (np.float64, np.float32):
            return FilterError(f"{name}: must be float64 or float32, not {array.dtype}")
    if len({array.dtype for array in arrays.values()}) > 1:
        described = ", ".join(f"{name} {array.dtype}" for name, array in arrays.items())
        return FilterError(f"arrays must agree in precision: {described}")
    return shape_error(**arrays)


def require_plain(**arrays: Any) -> None:
    """Raises FilterError for what is no array, or a masked one, or a matrix."""
    for name, array in arrays.items():
        if array.__class__ is not np.ndarray and not is_plain(array):
            raise array_error(**{name: array})


PLAIN: Final = (
    " (no masked array, no matrix: what is not measured is left out of y, its rows out of measure and R)"
)


def shape_error(**arrays: Array) -> FilterError:
    """The error for shapes that do not fit. It begins with the argument that has a wrong number of axes, if one
    has: the belief or its points decide how many the batch has."""
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
