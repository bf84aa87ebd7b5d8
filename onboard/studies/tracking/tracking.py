"""Many runs of one tracker in step: a batch of filters over the same scene, each with noise of its own."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError, NotPositiveDefiniteError, Rows, Update
from onboard.filters.gating import normalised_squared

Indices = npt.NDArray[np.intp]


class Sight(NamedTuple):
    """What is seen at one step: y (B, m), R (m, m) or (B, m, m), the measurement and its derivative over rows, and
    which components are angles."""

    y: Array
    R: Array
    measure: Rows
    jacobian: Rows | None = None
    angular: tuple[int, ...] = ()


class Tracker(NamedTuple):
    """A filter with all its settings, over batches: `belief` is for scoring, `root` what a square-root filter
    carries."""

    name: str
    label: str
    start: Callable[[Array, Array], Any]
    predict: Callable[[Any, Rows, Array], Any]
    update: Callable[[Any, Sight], Update]
    belief: Callable[[Any], Belief]
    root: Callable[[Any], Array] | None = None


class Scene(NamedTuple):
    """What a tracker is run on: B runs of T steps.

    `truth` is (T, n) or (T, B, n); `noise` a matrix (n, n) or a function of the step and of means (B, n);
    `sights` gives each step's measurements of all runs, or None.
    """

    truth: Array
    start: Array  # (B, n)
    covariance: Array  # (n, n)
    process: Rows
    noise: Array | Callable[[int, Array], Array]
    sights: Callable[[int], Sight | None]


class Trace(NamedTuple):
    """What became of it, after each step's update; NaN once a run's filter has failed."""

    mean: Array  # (T, B, n)
    sigma: Array  # (T, B, n), standard deviations by the filter's own account
    nees: Array  # (T, B)
    nis: Array  # (T, B), NaN without a measurement
    condition: Array  # (T, B), of what the filter carries: P, or its square root
    failed: Indices  # (B,), the step of a numerical failure, T if there was none


def follow(scene: Scene, tracker: Tracker, condition: bool = False) -> Trace:
    """Run the tracker over all runs. A run whose filter fails is taken out of the batch, the others go on."""
    steps, (runs, n) = len(scene.truth), scene.start.shape
    dtype = scene.start.dtype
    states, numbers = (steps, runs, n), (steps, runs)
    trace = Trace(
        mean=np.full(states, np.nan),
        sigma=np.full(states, np.nan),
        nees=np.full(numbers, np.nan),
        nis=np.full(numbers, np.nan),
        condition=np.full(numbers, np.nan),
        failed=np.full(runs, steps),
    )
    alive: Indices = np.arange(runs)
    state = tracker.start(scene.start, np.broadcast_to(scene.covariance, (runs, n, n)).copy())
    for k in range(steps):
        sight = scene.sights(k)
        state, alive, update = _step(scene, tracker, state, alive, sight, trace, k)
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
            trace.condition[k, alive] = np.linalg.cond(np.asarray(carried, dtype))
    return trace


def _step(
    scene: Scene, tracker: Tracker, state: Any, alive: Indices, sight: Sight | None, trace: Trace, k: int
) -> tuple[Any, Indices, Update | None]:
    """One step of the runs `alive`; those that fail are found one by one and left out."""
    while alive.size:
        try:
            return _advance(scene, tracker, k, state, alive, sight)
        except FilterError as error:
            if not _fails(error):
                raise
            sound = np.array(
                [_works(scene, tracker, k, state, i, alive[i : i + 1], sight) for i in range(alive.size)]
            )
            if sound.all():  # nobody fails alone
                raise
            trace.failed[alive[~sound]] = k
            state, alive = _pick(state, np.flatnonzero(sound)), alive[sound]
    return state, alive, None


def _works(scene: Scene, tracker: Tracker, k: int, state: Any, i: int, run: Indices, sight: Sight | None) -> bool:
    try:
        _advance(scene, tracker, k, _pick(state, np.array([i])), run, sight)
    except FilterError as error:
        if not _fails(error):
            raise
        return False
    return True


def _fails(error: FilterError) -> bool:
    """Whether it is of numbers; else the call is at fault, and no run."""
    return isinstance(error, NotPositiveDefiniteError) or "not finite" in str(error)


def _advance(
    scene: Scene, tracker: Tracker, k: int, state: Any, alive: Indices, sight: Sight | None
) -> tuple[Any, Indices, Update | None]:
    Q = scene.noise(k, state.mean) if callable(scene.noise) else scene.noise
    state = tracker.predict(state, scene.process, Q)
    if sight is None:
        return state, alive, None
    R = sight.R if sight.R.ndim == 2 else sight.R[alive]
    update = tracker.update(state, sight._replace(y=sight.y[alive], R=R))
    return update.belief, alive, update


def _pick(state: Any, chosen: Indices) -> Any:
    return type(state)(*(array[chosen] for array in state))
