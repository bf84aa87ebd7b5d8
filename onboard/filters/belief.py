"""Types that all filters share: beliefs, updates, models over rows, methods.

A model is a function over rows of states, (k, n) -> (k, n) or (k, m), and a filter has no loop over them. A
leading batch axis on a belief's arrays advances many filters in one call; the model still gets plain rows, those
of each filter together.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.errors import (
    AXES,
    OK,
    SHAPE_ERROR,
    WEIGHT_SUM_TOLERANCE,
    FilterError,
    NotPositiveDefiniteError,
    array_error,
    is_plain,
    raise_status,
)

__all__ = [
    "OK",
    "PROPERTIES",
    "ROWS",
    "SHAPE_ERROR",
    "Belief",
    "FilterError",
    "Indices",
    "Method",
    "NotPositiveDefiniteError",
    "Rows",
    "Update",
    "Weights",
    "array_error",
    "check_weights",
    "images_of",
    "mask",
    "over_rows",
    "raise_status",
    "start",
]

Rows = Callable[[Array], Array]
Indices = tuple[int, ...]


class Belief(NamedTuple):
    """A Gaussian estimate of a state.

    Attributes
    ----------
    mean : (..., n)
        Mean.
    covariance : (..., n, n)
        Covariance.
    """

    mean: Array
    covariance: Array


class Update(NamedTuple):
    """The result of a measurement update.

    Attributes
    ----------
    belief
        The posterior, of the filter's own type.
    innovation : (..., m)
        Measured minus predicted values, before the update.
    innovation_covariance : (..., m, m)
        Covariance of the innovation.
    predicted : (..., m)
        Predicted measurement.
    nis : float or (...,)
        Normalised innovation squared.
    misfits
        Names of parts of the measurement that were left out because they do not fit.
    passes
        Whether the measurement passed the filter's own gates, if it has any.
    log_evidence : (...,)
        Log-density of the measurement, if it is not that of a Gaussian innovation.
    """

    belief: Any
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: Any
    misfits: tuple[str, ...] = ()
    passes: bool = True
    log_evidence: Any = None


class Weights(NamedTuple):
    """A symmetric sigma-point set.

    Attributes
    ----------
    spread
        gamma, the distance of the outer points in standard deviations.
    mean, covariance
        Weights of the centre in the mean and in the covariance.
    other
        Weight of each of the 2n outer points.
    """

    spread: float
    mean: float
    covariance: float
    other: float


class Method(NamedTuple):
    """A filter as four pure functions, so that all filters can be tested alike.

    Attributes
    ----------
    name
        Its name in `methods`.
    start
        `start(mean, covariance) -> state`.
    predict
        `predict(state, process, Q, angular_states=()) -> state`.
    update
        `update(state, y, measure, R, angular=(), angular_states=()) -> Update`, whose `belief` is a state.
        `process` and `measure` are functions over rows; `angular` are the components of y that are angles and
        wrap, `angular_states` those of the state (`angles`).
    belief
        `belief(state) -> Belief`.
    factor
        `factor(state) -> S` (..., n, n) with S S^T the covariance, of methods that carry a factor.
    exempt
        Names of PROPERTIES that the method lacks by its nature, each with its reason in a sentence. The
        conformance suite (tests/conformance/test_methods.py) then requires that the property fails, so that no
        exemption outlives its reason.
    """

    name: str
    start: Callable[[Array, Array], Any]
    predict: Callable[..., Any]
    update: Callable[..., Update]
    belief: Callable[[Any], Belief]
    factor: Callable[[Any], Array] | None = None
    exempt: Mapping[str, str] = MappingProxyType({})


# Properties of every method, unless it is exempt.
PROPERTIES: Final = (
    "kalman",  # equals the Kalman filter on a linear problem
    "consistent",  # NEES and NIS keep their bounds on the model it assumes
    "partial",  # accepts measurements of fewer components than states
    "batch",  # one call with a batch axis equals a loop
    "long_run",  # positive definite over 1e5 ill-conditioned steps
    "angles",  # innovations of angles wrap
)


def check_weights(weights: Weights, n: int) -> None:
    """Check that weights are those of n states. Raises FilterError."""
    _, centre, _, other = weights
    others = 2 * n * other
    if abs(centre + others - 1.0) > WEIGHT_SUM_TOLERANCE * others:
        made_for = (1.0 - centre) / (2 * other)
        raise FilterError(
            f"weights: are for {made_for:.4g} states, not {n}: the centre's and those of 2 n others must sum to 1"
        )


@lru_cache(maxsize=256)
def mask(chosen: tuple[int, ...], size: int) -> Any:
    """Return a mask (size,) with the chosen components set.

    Raises FilterError for an index out of range.
    """
    made = np.zeros(size, bool)
    try:
        made[list(chosen)] = True
    except IndexError as error:
        raise FilterError(f"angular, considered or angular_states: {chosen}, of {size} components") from error
    made.flags.writeable = False  # cached, so shared
    return made


ROWS: Final = (
    "process and measure are called with rows of states, read-only: x of shape (k, n), not (n,). "
    "A component of all rows is x[:, i]; a model that changes its rows must copy them."
)


def over_rows(model: Rows, points: Array, y: Array | None = None) -> Array:
    """Evaluate a model over points (k, n), or over the rows of a batch (B, k, n).

    Without y the model is a process. It sees the points read-only, because the filter needs them again. Raises
    FilterError.
    """
    points.setflags(False)  # type: ignore[call-arg]  # NumPy takes it; by keyword it takes twice as long
    try:
        if points.ndim == 2:
            images = model(points)
            if images.__class__ is np.ndarray:
                return images
        else:
            images = model(points.reshape(-1, points.shape[-1]))
    except (ValueError, IndexError, TypeError) as error:
        error.add_note(ROWS)
        raise
    name = "process" if y is None else "measure"
    if not is_plain(images):
        raise array_error(**{name: images})
    if points.ndim == 2:
        return images
    if images.ndim != 2 or len(images) * points.shape[-1] != points.size:
        raise FilterError(f"{name}: gave {images.shape} for rows {(points[..., 0].size, points.shape[-1])}")
    return images.reshape(*points.shape[:-1], images.shape[-1])


def images_of(model: Rows, points: Array, y: Array | None) -> Array:
    """Evaluate a model over points (..., k, n).

    Without y it is a process and gives states (..., k, n); with y (..., m) it is a measurement and gives (..., k,
    m). Raises FilterError.
    """
    if y is not None and ((y.__class__ is not np.ndarray and not is_plain(y)) or y.ndim != points.ndim - 1):
        raise array_error(y=y, points=points)
    images = over_rows(model, points, y)
    columns = (points if y is None else y).shape[-1:]
    if images.shape != points.shape[:-1] + columns:
        name, beside = ("process", "") if y is None else ("measure", f" and y {y.shape}")
        raise FilterError(f"{name}: gave {images.shape} for points {points.shape}{beside}")
    return images


def start(mean: Array, covariance: Array) -> Belief:
    """Return the belief that a filter starts from.

    Type, shape and finiteness of the arrays are checked here, and only here.

    Parameters
    ----------
    mean : (..., n)
        Mean.
    covariance : (..., n, n)
        Covariance.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    for name, array in (("mean", mean), ("covariance", covariance)):
        if not is_plain(array) or array.dtype != np.float64:
            raise array_error(**{name: array})
        if array.ndim < AXES[name] or not np.isfinite(array).all():
            raise FilterError(f"{name}: must be finite, and have at least {AXES[name]} axes: has {array.shape}")
    if covariance.shape != (*mean.shape, mean.shape[-1]):
        described = f"mean {mean.shape}, covariance {covariance.shape}"
        raise FilterError(f"mean (..., n) and covariance (..., n, n) must fit: {described}")
    return Belief(mean, covariance)
