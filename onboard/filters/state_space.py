"""State-space models for whole records: what moves the state, what is measured of it, and how both change."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Rows
from onboard.filters.errors import FilterError, is_plain


class Model(NamedTuple):
    """x' = process(x) + noise of covariance Q (n, n); y = measure(x) + noise of covariance R (m, m). `process`
    maps rows (k, n) -> (k, n), `measure` rows (k, n) -> (k, m); `angular` are the components of y, and
    `angular_states` those of the state, that are angles and wrap. For an `imm` with a model for each mode, process
    and Q, and measure if it differs, are tuples. `process_jacobian` (k, n) -> (k, n, n) and `measure_jacobian`
    (k, n) -> (k, m, n) are for the filter "extended", which takes differences without them."""

    process: Any
    Q: Any
    measure: Any
    R: Array
    angular: tuple[int, ...] = ()
    angular_states: tuple[int, ...] = ()
    process_jacobian: Rows | None = None
    measure_jacobian: Rows | None = None


class LinearModel(NamedTuple):
    """x' = F x + input + noise Q; y = H x + noise R. F, Q (n, n), or (T-1, n, n) with those from each
    measurement to the next; H (m, n) and R (m, m), or (T, m, n) and (T, m, m); inputs (T-1, n), or (n,) where all
    are alike. Its states never wrap: an angle among them counts turns."""

    F: Array
    Q: Array
    H: Array
    R: Array
    inputs: Array | None = None
    angular: tuple[int, ...] = ()

    def at(self, k: int) -> Model:
        """The model of step k: what leads to measurement k, and what it measures."""
        F, Q = (_of_step(a, k - 1, 2) for a in (self.F, self.Q))
        H, R = (_of_step(a, k, 2) for a in (self.H, self.R))
        u = 0 if self.inputs is None else _of_step(self.inputs, k - 1, 1)
        return Model(lambda rows: rows @ F.T + u, Q, lambda rows: rows @ H.T, R, self.angular)

    def fitted(self, n: int, m: int, steps: int, dtype: Any) -> "LinearModel":
        """The same of `dtype`, with inputs (T-1, n), for a record of T = `steps` measurements (m,) of n states.

        Raises FilterError where a shape does not fit the record, or a number is not finite.
        """
        made: dict[str, Any] = {
            "F": _checked("F", self.F, (n, n), steps - 1, dtype),
            "Q": _checked("Q", self.Q, (n, n), steps - 1, dtype),
            "H": _checked("H", self.H, (m, n), steps, dtype),
            "R": _checked("R", self.R, (m, m), steps, dtype),
        }
        if self.inputs is not None:
            given = _checked("inputs", self.inputs, (n,), steps - 1, dtype)
            made["inputs"] = np.broadcast_to(given, (max(steps - 1, 1), n))  # of one measurement none is used
        return self._replace(**made)


class Step(NamedTuple):
    """A measurement's number, its time, and the time since the one before (NaN for the first)."""

    k: int
    t: float
    dt: float


AnyModel = Model | LinearModel | Callable[[Step], Model]


def model_at(model: AnyModel, ts: Array, k: int) -> Model:
    """The model that leads to measurement k, and measures it."""
    if isinstance(model, Model):
        return model
    if isinstance(model, LinearModel):
        return model.at(k)
    return model(Step(k, float(ts[k]), float(ts[k] - ts[k - 1]) if k else float("nan")))


def _of_step(array: Array, k: int, axes: int) -> Array:
    one: Array = array if array.ndim == axes else array[max(k, 0)]
    return one


def _checked(name: str, given: Any, shape: tuple[int, ...], count: int, dtype: Any) -> Array:
    """An array of this shape, or of `count` such, in a precision."""
    array = np.asarray(given)
    if (isinstance(given, np.ndarray) and not is_plain(given)) or array.dtype.kind not in "fiub":
        raise FilterError(f"{name}: must be an array of numbers, not {type(given).__name__} of {array.dtype}")
    if array.shape not in {shape, (count, *shape)} or not np.isfinite(array).all():
        raise FilterError(f"{name}: must be finite and {shape}, or {(count, *shape)}, not {array.shape}")
    if array.ndim > len(shape) and not count:
        return np.zeros(shape, dtype)
    return array.astype(dtype, copy=False)
