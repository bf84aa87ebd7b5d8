"""State-space models for whole records: what moves the state, what is measured of it, and how both change."""

from collections.abc import Callable
from typing import Any, NamedTuple

from onboard.arrays import Array


class Model(NamedTuple):
    """x' = process(x) + noise of covariance Q (n, n); y = measure(x) + noise of covariance R (m, m). `process`
    maps rows (k, n) -> (k, n), `measure` rows (k, n) -> (k, m); `angular` are the components of y, and
    `angular_states` those of the state, that are angles and wrap. For an `imm` with a model for each mode, process
    and Q, and measure if it differs, are tuples."""

    process: Any
    Q: Any
    measure: Any
    R: Array
    angular: tuple[int, ...] = ()
    angular_states: tuple[int, ...] = ()


class LinearModel(NamedTuple):
    """x' = F x + input + noise Q; y = H x + noise R. F, Q (n, n), or (T-1, n, n) with those from each
    measurement to the next; H (m, n) and R (m, m), or (T, m, n) and (T, m, m); inputs (T-1, n). Its states never
    wrap: an angle among them counts turns."""

    F: Array
    Q: Array
    H: Array
    R: Array
    inputs: Array | None = None
    angular: tuple[int, ...] = ()

    def at(self, k: int) -> Model:
        """The model of step k: what leads to measurement k, and what it measures."""
        F, Q = (_of_step(a, k - 1) for a in (self.F, self.Q))
        H, R = (_of_step(a, k) for a in (self.H, self.R))
        u = 0 if self.inputs is None else self.inputs[max(k - 1, 0)]
        return Model(lambda rows: rows @ F.T + u, Q, lambda rows: rows @ H.T, R, self.angular)


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


def _of_step(matrix: Array, k: int) -> Array:
    return matrix if matrix.ndim == 2 else matrix[max(k, 0)]
