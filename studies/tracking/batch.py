"""A batch of runs of one tracker: many filters over the same scene, each with its own noise."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError, NotPositiveDefiniteError, Rows, Update
from onboard.filters.errors import SpreadError
from onboard.filters.gating import normalised_squared

Indices = npt.NDArray[np.intp]


class Measurement(NamedTuple):
    """The measurements of one step in all runs."""

    y: Array  # (B, m)
    R: Array  # (m, m) or (B, m, m)
    measure: Rows  # over rows of states
    jacobian: Rows | None = None  # over rows of states
    angular: tuple[int, ...] = ()  # indices of components that are angles


class Tracker(NamedTuple):
    """A filter with all its settings, over batches.

    `belief` gives mean and covariance, for scoring; `root` the factor of a square-root filter.
    """

    name: str
    label: str
    predict: Callable[[Any, Rows, Array], Any]
    update: Callable[[Any, Measurement], Update]
    start: Callable[[Array, Array], Any] = Belief
    belief: Callable[[Any], Belief] = lambda state: state
    root: Callable[[Any], Array] | None = None


class Scene(NamedTuple):
    """B runs of T steps: the input of a tracker, and the truth.

    `truth` is (T, n) or (T, B, n); `noise` the process noise (n, n), or a function of the step and of means (B,
    n); `measurements` gives each step's measurement, or None.
    """

    truth: Array
    start: Array  # (B, n)
    covariance: Array  # (n, n)
    process: Rows
    noise: Array | Callable[[int, Array], Array]
    measurements: Callable[[int], Measurement | None]


class Trace(NamedTuple):
    """The filters after each step's update; NaN once a run's filter has failed."""

    mean: Array  # (T, B, n)
    sigma: Array  # (T, B, n), the filter's own standard deviations
    nees: Array  # (T, B)
    nis: Array  # (T, B), NaN without a measurement
    condition: Array  # (T, B), condition number of what the filter carries: P, or its square root
    failed: Indices  # (B,), the step of a numerical failure, T if there was none


def run_batch(scene: Scene, tracker: Tracker, condition: bool = False) -> Trace:
    """Run the tracker over a scene; with `condition`, record condition numbers.

    A run whose filter fails numerically is removed from the batch, the others go on. Raises FilterError for an
    error that no run has alone.
    """
    steps, (runs, n) = len(scene.truth), scene.start.shape
    trace = Trace(
        mean=np.full((steps, runs, n), np.nan),
        sigma=np.full((steps, runs, n), np.nan),
        nees=np.full((steps, runs), np.nan),
        nis=np.full((steps, runs), np.nan),
        condition=np.full((steps, runs), np.nan),
        failed=np.full(runs, steps),
    )
    alive: Indices = np.arange(runs)
    state = tracker.start(scene.start, np.broadcast_to(scene.covariance, (runs, n, n)).copy())
    for k in range(steps):
        state, alive, update = _step(scene, tracker, state, alive, trace, k)
        if not alive.size:
            break
        belief = tracker.belief(state)
        error = belief.mean - np.broadcast_to(scene.truth[k], (runs, n))[alive]
        trace.mean[k, alive] = belief.mean
        trace.sigma[k, alive] = np.sqrt(np.abs(np.einsum("bii->bi", belief.covariance)))
        trace.nees[k, alive] = normalised_squared(error, belief.covariance)
        if update is not None:
            trace.nis[k, alive] = update.nis
        if condition:
            carried = belief.covariance if tracker.root is None else tracker.root(state)
            trace.condition[k, alive] = np.linalg.cond(carried)
    return trace


def _step(
    scene: Scene, tracker: Tracker, state: Any, alive: Indices, trace: Trace, k: int
) -> tuple[Any, Indices, Update | None]:
    """One step of the runs `alive`; those that fail are found one by one and left out."""
    while alive.size:
        try:
            return _advance(scene, tracker, k, state, alive)
        except FilterError as error:
            if not _is_numerical(error):
                raise
            sound = np.array(
                [_works(scene, tracker, k, _pick(state, np.array([i])), alive[[i]]) for i in range(alive.size)]
            )
            if sound.all():  # no run fails alone
                raise
            trace.failed[alive[~sound]] = k
            state, alive = _pick(state, np.flatnonzero(sound)), alive[sound]
    return state, alive, None


def _works(scene: Scene, tracker: Tracker, k: int, state: Any, run: Indices) -> bool:
    """Whether the step of a single run succeeds."""
    try:
        _advance(scene, tracker, k, state, run)
    except FilterError as error:
        if not _is_numerical(error):
            raise
        return False
    return True


def _is_numerical(error: FilterError) -> bool:
    """Whether the numbers of a run are at fault, and not the call."""
    return isinstance(error, NotPositiveDefiniteError | SpreadError) or "not finite" in str(error)


def _advance(
    scene: Scene, tracker: Tracker, k: int, state: Any, alive: Indices
) -> tuple[Any, Indices, Update | None]:
    Q = scene.noise(k, state.mean) if callable(scene.noise) else scene.noise
    state = tracker.predict(state, scene.process, Q)
    measurement = scene.measurements(k)
    if measurement is None:
        return state, alive, None
    R = measurement.R if measurement.R.ndim == 2 else measurement.R[alive]
    update = tracker.update(state, measurement._replace(y=measurement.y[alive], R=R))
    return update.belief, alive, update


def _pick(state: Any, chosen: Indices) -> Any:
    return type(state)(*(array[chosen] for array in state))
