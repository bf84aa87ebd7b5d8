"""What all filters share: beliefs, updates, models over rows, errors, and how a method is described.

A model is a function over rows of states, (k, n) -> (k, n) or (k, m), and a filter never sees a loop over them.
A leading batch axis on a belief's arrays advances many filters in one call; the model still gets plain rows,
those of each filter together.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array

Rows = Callable[[Array], Array]


class Belief(NamedTuple):
    """A filter's estimate: mean (..., n) and covariance (..., n, n)."""

    mean: Array
    covariance: Array


class Update(NamedTuple):
    """A measurement update: the posterior, the innovation (..., m) (before the update), its covariance (..., m,
    m), the predicted measurement (..., m), and the normalised innovation squared (a float, or (...,)).
    `misfits`: the names of parts of the measurement that were left out, since they do not fit. `passes`: whether
    the filter's own gates, if it has any, let the measurement pass. `log_evidence` (...,): the log-density of the
    measurement, where it is not that of a Gaussian innovation."""

    belief: Any
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: Any
    misfits: tuple[str, ...] = ()
    passes: bool = True
    log_evidence: Any = None


class Weights(NamedTuple):
    """A symmetric sigma-point set: `spread` is gamma, the distance in standard deviations; the centre's weight in
    the mean and in the covariance; and the weight of each of the 2n others."""

    spread: float
    mean: float
    covariance: float
    other: float


class Method(NamedTuple):
    """A filter as four pure functions, so that all can be held to the same tests.

    `start(mean, covariance) -> state`; `predict(state, process, Q) -> state`; `update(state, y, measure, R,
    angular) -> Update` whose `belief` is a state; `belief(state) -> Belief`. `process` and `measure` are functions
    over rows; `angular` are the components of y that are angles and wrap.

    `exempt` names those of PROPERTIES that the method does not have by its nature, each with its reason in a
    sentence. The conformance suite (tests/conformance/test_methods.py) then demands that the property does
    fail, so that no exemption outlives its reason. `factor(state) -> S` (..., n, n), S S^T the covariance, of
    methods that carry a factor.
    """

    name: str
    start: Callable[[Array, Array], Any]
    predict: Callable[[Any, Rows, Array], Any]
    update: Callable[[Any, Array, Rows, Array, tuple[int, ...]], Update]
    belief: Callable[[Any], Belief]
    factor: Callable[[Any], Array] | None = None
    exempt: Mapping[str, str] = MappingProxyType({})


# What every method does, unless it is exempt.
PROPERTIES: Final = (
    "kalman",  # on a linear problem it is the Kalman filter
    "consistent",  # NEES and NIS keep their bounds on the model it assumes
    "partial",  # it takes measurements of fewer components than states
    "batch",  # one call with a batch axis does what a loop would
    "float32",  # float32 in gives float32 out
    "long_run",  # positive definite over 1e5 ill-conditioned steps
    "long_run_float32",  # the same in single precision
    "angles",  # innovations of angles wrap
)


class FilterError(ValueError):
    """An argument cannot be used; the message says which one and why. Nothing passed in has been changed."""


class NotPositiveDefiniteError(FilterError):
    """A covariance has no Cholesky factor (or is not finite), so the step cannot be made."""


# The status that a compiled kernel returns: OK, or what is wrong.
OK: Final = 0
MEAN: Final = 1
COVARIANCE: Final = 2
NOISE: Final = 3
POINTS: Final = 4
IMAGES: Final = 5
MEASUREMENT: Final = 6
INNOVATION: Final = 7
SHAPE: Final = 8
MATRIX: Final = 9
INDEFINITE: Final = 10
FACTOR: Final = 11
DOWNDATE: Final = 12
PREDICTED: Final = 13
POSTERIOR: Final = 14

REASONS: Final = {
    MEAN: "mean: not finite",
    COVARIANCE: "covariance: not positive definite",
    NOISE: "Q or R: not finite",
    POINTS: "process: gave states that are not finite",
    IMAGES: "measure: gave measurements that are not finite",
    MEASUREMENT: "y: not finite",
    INNOVATION: "innovation covariance (R in it): not positive definite",
    SHAPE: "shapes do not fit: mean (n,), covariance and Q (n, n), process (k, n) to (k, n), y (m,), R (m, m), "
    "measure (k, n) to (k, m)",
    MATRIX: "F or H: not finite",
    INDEFINITE: "Q or R: not positive semi-definite, so it has no square root",
    FACTOR: "factor: not lower triangular with a positive diagonal, or not finite",
    DOWNDATE: "downdate: leaves a factor that is not positive definite",
    PREDICTED: "predicted covariance: not positive definite",
    POSTERIOR: "covariance after the update: not positive definite",
}


def raise_status(status: int) -> None:
    """Raise FilterError or NotPositiveDefiniteError for a kernel's status that is not OK."""
    square_roots = {COVARIANCE, INNOVATION, INDEFINITE, FACTOR, DOWNDATE, PREDICTED, POSTERIOR}
    kind = NotPositiveDefiniteError if status in square_roots else FilterError
    raise kind(REASONS[status])


def array_error(**arrays: Any) -> FilterError:
    """The error for arguments that no kernel takes: not arrays, not of floating point, or of different precision
    or rank."""
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):
            return FilterError(f"{name}: must be a NumPy array, not {type(array).__name__}")
        if array.dtype not in (np.float64, np.float32):
            return FilterError(f"{name}: must be float64 or float32, not {array.dtype}")
    described = ", ".join(f"{name} {array.dtype} {array.shape}" for name, array in arrays.items())
    return FilterError(f"arrays must agree in precision and in batch axes: {described}")


@lru_cache(maxsize=256)
def mask(chosen: tuple[int, ...], size: int) -> Any:
    """A mask (size,) with the chosen components set."""
    made = np.zeros(size, bool)
    made[list(chosen)] = True
    made.flags.writeable = False  # cached, so shared
    return made


def over_rows(model: Rows, points: Array) -> Array:
    """A model over points (k, n), or over the rows of a batch (B, k, n). Raises FilterError."""
    if points.ndim == 2:
        return model(points)
    rows = points.reshape(-1, points.shape[-1])
    images = model(rows)
    if images.ndim != 2 or len(images) != len(rows):
        raise FilterError(f"process or measure: gave {images.shape} for rows {rows.shape}")
    return images.reshape(*points.shape[:-1], images.shape[-1])


def images_of(model: Rows, points: Array, y: Array | None) -> Array:
    """A model over points (..., k, n): without y it is a process and gives states (..., k, n); with y (..., m)
    it is a measurement and gives (..., k, m).

    Raises FilterError.
    """
    images = over_rows(model, points)
    columns = np.shape(points if y is None else y)[-1:]
    if np.shape(images) != points.shape[:-1] + columns:
        name, beside = ("process", "") if y is None else ("measure", f" and y {np.shape(y)}")
        raise FilterError(f"{name}: gave {np.shape(images)} for points {points.shape}{beside}")
    return images


def start(mean: Array, covariance: Array) -> Belief:
    """The belief that a filter starts from. Type, shape and finiteness of the arrays are checked here, and once.

    Raises FilterError.
    """
    for name, array, axes in (("mean", mean, 1), ("covariance", covariance, 2)):
        if not isinstance(array, np.ndarray):
            raise FilterError(f"{name}: must be a NumPy array, not {type(array).__name__}")
        if array.dtype not in (np.float64, np.float32):
            raise FilterError(f"{name}: must be float64 or float32, not {array.dtype}")
        if array.ndim < axes or not np.isfinite(array).all():
            raise FilterError(f"{name}: must be finite, and have at least {axes} axes: has shape {array.shape}")
    if covariance.shape != (*mean.shape, mean.shape[-1]) or mean.dtype != covariance.dtype:
        described = f"mean {mean.dtype} {mean.shape}, covariance {covariance.dtype} {covariance.shape}"
        raise FilterError(
            f"mean (..., n) and covariance (..., n, n) must fit and be of one precision: {described}"
        )
    return Belief(mean, covariance)
