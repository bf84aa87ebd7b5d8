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
from onboard.filters.errors import (
    AXES,
    NEAR,
    OK,
    SHAPE,
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
    "SHAPE",
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

    `start(mean, covariance) -> state`; `predict(state, process, Q, angular_states=()) -> state`; `update(state, y,
    measure, R, angular=(), angular_states=()) -> Update` whose `belief` is a state; `belief(state) -> Belief`.
    `process` and `measure` are functions over rows; `angular` are the components of y that are angles and wrap,
    `angular_states` those of the state (`angles`).

    `exempt` names those of PROPERTIES that the method does not have by its nature, each with its reason in a
    sentence. The conformance suite (tests/conformance/test_methods.py) then demands that the property does
    fail, so that no exemption outlives its reason. `factor(state) -> S` (..., n, n), S S^T the covariance, of
    methods that carry a factor.
    """

    name: str
    start: Callable[[Array, Array], Any]
    predict: Callable[..., Any]
    update: Callable[..., Update]
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


def check_weights(weights: Weights, n: int) -> None:
    """Check that weights are those of n states.

    Raises FilterError.
    """
    _, centre, _, other = weights
    others = 2 * n * other
    if abs(centre + others - 1.0) > NEAR * others:
        made_for = (1.0 - centre) / (2 * other)
        raise FilterError(
            f"weights: are for {made_for:.4g} states, not {n}: the centre's and those of 2 n others must sum to 1"
        )


@lru_cache(maxsize=256)
def mask(chosen: tuple[int, ...], size: int) -> Any:
    """A mask (size,) with the chosen components set. Raises FilterError for one that there is not."""
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
    """A model over points (k, n), or over the rows of a batch (B, k, n); without y it is a process. It sees the
    points read-only, because the filter needs them again.

    Raises FilterError.
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
    """A model over points (..., k, n): without y it is a process and gives states (..., k, n); with y (..., m)
    it is a measurement and gives (..., k, m).

    Raises FilterError.
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
    """The belief that a filter starts from. Type, shape and finiteness of the arrays are checked here, and once.

    Raises FilterError.
    """
    for name, array in (("mean", mean), ("covariance", covariance)):
        if not is_plain(array) or array.dtype not in (np.float64, np.float32):
            raise array_error(**{name: array})
        if array.ndim < AXES[name] or not np.isfinite(array).all():
            raise FilterError(f"{name}: must be finite, and have at least {AXES[name]} axes: has {array.shape}")
    if covariance.shape != (*mean.shape, mean.shape[-1]) or mean.dtype != covariance.dtype:
        described = f"mean {mean.dtype} {mean.shape}, covariance {covariance.dtype} {covariance.shape}"
        raise FilterError(
            f"mean (..., n) and covariance (..., n, n) must fit and be of one precision: {described}"
        )
    return Belief(mean, covariance)
