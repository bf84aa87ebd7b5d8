"""State-space models for whole records: process, measurement, and their changes over time."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Rows
from onboard.filters.errors import FilterError, is_plain


class Model(NamedTuple):
    """A model x' = process(x) + noise Q, y = measure(x) + noise R.

    For an `imm` with a model for each mode, `process` and `Q`, and `measure` if it differs, are tuples.

    Attributes
    ----------
    process
        Function of rows (k, n); returns rows (k, n).
    Q : (n, n)
        Covariance of the process noise.
    measure
        Function of rows (k, n); returns rows (k, m).
    R : (m, m)
        Covariance of the measurement noise.
    angular, angular_states
        Components of y, and of the state, that are angles and wrap.
    process_jacobian, measure_jacobian
        Jacobians over rows, (k, n) -> (k, n, n) and (k, n) -> (k, m, n), for the filter "extended", which uses
        differences without them.
    """

    process: Any
    Q: Any
    measure: Any
    R: Array
    angular: tuple[int, ...] = ()
    angular_states: tuple[int, ...] = ()
    process_jacobian: Rows | None = None
    measure_jacobian: Rows | None = None


class LinearModel(NamedTuple):
    """A linear model x' = F x + input + noise Q, y = H x + noise R.

    Its states never wrap: an angle among them counts turns.

    Attributes
    ----------
    F, Q : (n, n) or (T-1, n, n)
        Transition and noise, constant, or from each measurement to the next.
    H, R
        Measurement matrix (m, n) and noise (m, m), constant, or (T, m, n) and (T, m, m).
    inputs : (n,) or (T-1, n)
        Added to each prediction.
    angular
        Components of y that are angles and wrap.
    """

    F: Array
    Q: Array
    H: Array
    R: Array
    inputs: Array | None = None
    angular: tuple[int, ...] = ()

    def at(self, k: int) -> Model:
        """Return the model of step k: the transition to measurement k, and its measurement."""
        F, Q = (_of_step(a, k - 1, 2) for a in (self.F, self.Q))
        H, R = (_of_step(a, k, 2) for a in (self.H, self.R))
        u = 0 if self.inputs is None else _of_step(self.inputs, k - 1, 1)
        return Model(lambda rows: rows @ F.T + u, Q, lambda rows: rows @ H.T, R, self.angular)

    def fitted(self, n: int, m: int, steps: int) -> "LinearModel":
        """Return the same model of float64, with inputs (T-1, n), for a record.

        The record has T = `steps` measurements (m,) of n states.

        Raises
        ------
        FilterError
            If a shape does not fit the record, or a number is not finite.
        """
        made: dict[str, Any] = {
            "F": _checked("F", self.F, (n, n), steps - 1),
            "Q": _checked("Q", self.Q, (n, n), steps - 1),
            "H": _checked("H", self.H, (m, n), steps),
            "R": _checked("R", self.R, (m, m), steps),
        }
        if self.inputs is not None:
            given = _checked("inputs", self.inputs, (n,), steps - 1)
            made["inputs"] = np.broadcast_to(given, (max(steps - 1, 1), n))  # of one measurement none is used
        return self._replace(**made)


class Step(NamedTuple):
    """A measurement's number, its time, and the time since the one before (0 for the first)."""

    k: int
    t: float
    dt: float


AnyModel = Model | LinearModel | Callable[[Step], Model | LinearModel]


def model_at(model: AnyModel, ts: Array, k: int) -> Model:
    """Return the model that leads to measurement k, and measures it."""
    if isinstance(model, Model):
        return model
    if isinstance(model, LinearModel):
        return model.at(k)
    made = model(Step(k, float(ts[k]), float(ts[k] - ts[k - 1]) if k else 0.0))
    if isinstance(made, LinearModel):
        return made.at(k)
    if not isinstance(made, Model):
        raise FilterError(f"model: a function of the Step must return its Model, not {type(made).__name__}")
    return made


def seconds(ts: Any) -> Array:
    """Times as numbers of seconds; those with a unit of their own, as datetime64, since the first. Raises
    FilterError."""
    times = np.asarray(ts)
    if times.dtype.kind == "M" and times.size:
        times = times - times.flat[0]
    if times.dtype.kind == "m":
        times = np.where(np.isnat(times), np.nan, times / np.timedelta64(1, "s"))
    try:
        return times.astype(float)
    except (TypeError, ValueError) as error:
        raise FilterError(f"ts: must be numbers of seconds, or datetime64, not {times.dtype}") from error


def _of_step(array: Array, k: int, axes: int) -> Array:
    one: Array = array if array.ndim == axes else array[max(k, 0)]
    return one


def _checked(name: str, given: Any, shape: tuple[int, ...], count: int) -> Array:
    """Return an array of this shape, or of `count` such."""
    array = np.asarray(given)
    if (isinstance(given, np.ndarray) and not is_plain(given)) or array.dtype.kind not in "fiub":
        raise FilterError(f"{name}: must be an array of numbers, not {type(given).__name__} of {array.dtype}")
    if array.shape not in {shape, (count, *shape)} or not np.isfinite(array).all():
        raise FilterError(f"{name}: must be finite and {shape}, or {(count, *shape)}, not {array.shape}")
    if array.ndim > len(shape) and not count:
        return np.zeros(shape)
    return array.astype(float, copy=False)
