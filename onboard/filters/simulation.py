"""Records drawn from a model, to test a filter.

    truth, ys = simulate(model, start, 100, np.random.default_rng(1))          # (T, n), (T, m)
    found = run("unscented", model, start, ys)
    consistency.nees(found, truth).inside

The first state is drawn from the belief `start`, which is that of the first measurement's time, as in `run`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, FilterError, over_rows
from onboard.filters.belief import start as checked
from onboard.filters.kernels.noise import noise_factor
from onboard.filters.state_space import AnyModel, LinearModel, model_at, seconds


class Simulated(NamedTuple):
    """A simulated record.

    Attributes
    ----------
    truth : (T, ..., n)
        States.
    ys : (T, ..., m)
        Measurements; a list of (..., m) if their size changes.
    """

    truth: Array
    ys: Any


def simulate(
    model: AnyModel, start: Belief, ts: int | Sequence[float] | Array, rng: np.random.Generator
) -> Simulated:
    """Draw states and measurements from a model. Measured angles are in [-pi, pi].

    Parameters
    ----------
    model
        The model, as in `run`.
    start
        Belief of the first state. A batch, mean (B, n), gives B records.
    ts : int or (T,)
        Times, or their number at 0, 1, ...
    rng
        Source of random numbers.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, covariance = checked(*start)
    times = np.arange(float(ts)) if isinstance(ts, int) else seconds(ts)
    if times.ndim != 1 or not len(times) or not np.all(np.diff(times) >= 0):
        raise FilterError(f"ts: must be times that do not decrease, or a number of at least 1, not {ts}")
    if isinstance(model, LinearModel):
        model = model.fitted(mean.shape[-1], np.shape(model.H)[-2], len(times))
    x = mean + _drawn("covariance", covariance, mean.shape, rng)
    truth, ys = [], []
    for k in range(len(times)):
        step = model_at(model, times, k)
        if isinstance(step.process, tuple) or isinstance(step.measure, tuple) or isinstance(step.Q, tuple):
            raise FilterError("model: has several modes; simulate each stretch by the model of its mode")
        if k and times[k] > times[k - 1]:
            x = over_rows(step.process, x[..., None, :])[..., 0, :]
            x = x + _drawn("Q", step.Q, x.shape, rng)
        image = over_rows(step.measure, x[..., None, :], x)[..., 0, :]
        y = image + _drawn("R", step.R, image.shape, rng)
        truth.append(x)
        ys.append(beside(y, np.zeros_like(y), step.angular))
    same = all(y.shape == ys[0].shape for y in ys)
    return Simulated(np.stack(truth), np.stack(ys) if same else ys)


def _drawn(name: str, covariance: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Return noise (..., m) of a covariance (..., m, m), which may be singular."""
    z = rng.standard_normal(shape)
    return np.asarray((noise_factor(name, covariance) @ z[..., None])[..., 0])
