"""Figures of a run with matplotlib (`pip install matplotlib`).

    plots.track(found.beliefs, truth)      # a path with its ellipses
    plots.nis(found)                       # with bounds
    plots.nees(found, truth)
    plots.errors(found, truth)             # each state's, within its sigmas; angles wrap

Each draws on `axes`, or on new ones, and returns them: `.figure.savefig(...)`.
"""

from typing import Any

import numpy as np

from onboard.arrays import Array
from onboard.filters import consistency
from onboard.filters.belief import Belief, FilterError, Indices
from onboard.filters.gating import chi_square_threshold
from onboard.filters.runs import Run


def ellipse(belief: Belief, states: tuple[int, int] = (0, 1), probability: float = 0.95, axes: Any = None) -> Any:
    """Draw the ellipse that contains two states of a belief (n,) with a probability."""
    made = _axes(axes)
    made.plot(*outline(belief, states, probability), color="tab:blue", linewidth=0.8)
    return made


def outline(belief: Belief, states: tuple[int, int] = (0, 1), probability: float = 0.95) -> Array:
    """Return points (2, 73) of the ellipse that `ellipse` draws."""
    mean, P = belief.mean[list(states)], belief.covariance[np.ix_(states, states)]
    values, vectors = np.linalg.eigh(P)
    angle = np.linspace(0, 2 * np.pi, 73)
    radius = np.sqrt(chi_square_threshold(probability, 2) * np.maximum(values, 0))
    return np.asarray(mean[:, None] + vectors @ (radius[:, None] * np.stack([np.cos(angle), np.sin(angle)])))


def track(
    beliefs: Belief, truth: Array | None = None, states: tuple[int, int] = (0, 1), every: int = 5, axes: Any = None
) -> Any:
    """Draw the path of two states of one run, mean (T, n).

    Every `every`-th time has its 95 % ellipse.
    """
    _one_run(beliefs)
    made, (a, b) = _axes(axes), states
    made.plot(beliefs.mean[:, a], beliefs.mean[:, b], ".-", color="tab:blue", markersize=3, label="estimate")
    if truth is not None:
        made.plot(truth[:, a], truth[:, b], color="black", linewidth=0.8, label="truth")
    for k in range(0, len(beliefs.mean), every):
        ellipse(Belief(beliefs.mean[k], beliefs.covariance[k]), states, axes=made)
    made.set_aspect("equal", adjustable="datalim")
    made.legend()
    return made


def nis(found: Run, probability: float = 0.95, axes: Any = None) -> Any:
    """Draw NIS over time, the mean of a batch, with its bounds."""
    return _bounds(consistency.nis(found, probability), found.ts, "NIS", axes)


def nees(
    beliefs: Belief | Run,
    truth: Array,
    ts: Array | None = None,
    axes: Any = None,
    angular_states: Indices | None = None,
) -> Any:
    """Draw NEES over time, the mean of a batch, with its 95 % bounds.

    `angular_states` is as in `consistency.nees`.
    """
    found = consistency.nees(beliefs, truth, angular_states=angular_states)
    return _bounds(found, _of_run(ts, beliefs), "NEES", axes)


def errors(
    beliefs: Belief | Run,
    truth: Array,
    ts: Array | None = None,
    sigmas: float = 2.0,
    angular_states: Indices | None = None,
) -> Any:
    """Draw each state's error in one run, mean (T, n), within its band of `sigmas`.

    Returns an array of axes (n,). `angular_states` is as in `consistency.nees`.
    """
    from matplotlib import pyplot  # noqa: PLC0415 - an extra

    error, ts = consistency.errors(beliefs, truth, angular_states), _of_run(ts, beliefs)
    beliefs = consistency.of_run(beliefs)
    _one_run(beliefs)
    n = beliefs.mean.shape[1]
    _, made = pyplot.subplots(n, 1, sharex=True, squeeze=False, layout="constrained")
    time = _times(ts, len(beliefs.mean))
    for i, axes in enumerate(made[:, 0]):
        band = sigmas * np.sqrt(beliefs.covariance[:, i, i])
        axes.fill_between(time, -band, band, color="tab:blue", alpha=0.2)
        axes.plot(time, error[:, i], color="tab:blue")
        axes.set_ylabel(f"state {i}")
    return made[:, 0]


def _bounds(found: consistency.ConsistencyBounds, ts: Array | None, name: str, axes: Any) -> Any:
    made, time = _axes(axes), _times(ts, len(found.mean))
    made.fill_between(time, found.low, found.high, color="tab:green", alpha=0.2, label="bounds")
    made.plot(time, found.mean, color="tab:blue", label=f"{name}, {100 * found.inside:.0f} % inside")
    made.plot(time, found.expected, color="tab:green", linewidth=0.8)
    made.set_ylabel(name)
    made.legend()
    return made


def _one_run(beliefs: Belief) -> None:
    if beliefs.mean.ndim != 2:
        raise FilterError(
            f"beliefs: must be of one run, mean (T, n), not {beliefs.mean.shape}: take one, mean[:, 0]"
        )


def _of_run(ts: Array | None, beliefs: Belief | Run) -> Array | None:
    return beliefs.ts if ts is None and isinstance(beliefs, Run) else ts


def _times(ts: Array | None, count: int) -> Array:
    return np.arange(float(count)) if ts is None else ts


def _axes(axes: Any) -> Any:
    if axes is not None:
        return axes
    from matplotlib import pyplot  # noqa: PLC0415 - an extra

    return pyplot.subplots(layout="constrained")[1]
