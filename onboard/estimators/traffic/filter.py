"""Filters of the tracker, under one interface.

    state = tracks.predict(state, dt, attitude_error, report_errors)
    part = take(state, rows)                        # of some tracks
    state = put(state, rows, update.belief)

They are those of `onboard.filters` with the model of an intruder. A state is a tree of arrays whose first axis
counts tracks.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.linalg import expm

from onboard.arrays import Array
from onboard.estimators.traffic.config import FilterName
from onboard.filters import extended, kalman, multiple_model, square_root, unscented
from onboard.filters.association import Places
from onboard.filters.belief import Belief, Method, Rows, Update
from onboard.models.intruder import motion
from onboard.models.intruder.attitude_error import AttitudeErrorModel, ReportErrors, with_report_errors

SINGLE: Final[dict[str, Method]] = {
    "kf": kalman.METHODS[0],
    "ekf": extended.METHODS[0],
    "ukf": unscented.METHODS[0],
    "srukf": square_root.METHODS[0],
}


class TrackFilter(NamedTuple):
    """A filter over tracks: a `onboard.filters.belief.Method` whose `predict` knows the model.

    Attributes
    ----------
    predict
        Called as `predict(state, dt, attitude_error, report_errors)`.
    change
        Called as `change(state, f)`; applies `f` to every belief in a state, one for each track, or one for each
        mode of each track.
    polar
        Whether `update` accepts range and angles. Otherwise it needs Cartesian positions.
    """

    start: Callable[[Array, Array], Any]
    predict: Callable[[Any, float, AttitudeErrorModel, ReportErrors], Any]
    update: Callable[[Any, Array, Rows, Array, tuple[int, ...]], Update]
    belief: Callable[[Any], Belief]
    change: Callable[[Any, Callable[[Belief], Belief]], Any]
    polar: bool


def track_filter(
    name: FilterName, models: Sequence[motion.MotionModel], durations: Sequence[float]
) -> TrackFilter:
    """Return the filter of that name.

    The mixture of extended filters has a mode for each of `models`, with its mean duration in s; single filters
    have the last model.
    """
    if name == "imm":
        return _mixture((extended.METHODS[0],) * len(models), models, durations)
    method, step = SINGLE[name], _cached_step(models[-1])

    def predict(state: Any, dt: float, attitude_error: AttitudeErrorModel, errors: ReportErrors) -> Any:
        then = with_report_errors(step(dt), errors, attitude_error)
        return method.predict(state, _process(then), then.Q)

    def change(state: Any, f: Callable[[Belief], Belief]) -> Any:
        return method.start(*f(method.belief(state)))

    return TrackFilter(method.start, predict, method.update, method.belief, change, name != "kf")


def _mixture(
    modes: Sequence[Method], models: Sequence[motion.MotionModel], durations: Sequence[float]
) -> TrackFilter:
    """Return interacting filters, one for each mode, with different motion models.

    A mode changes to any other at the same rate, so that in the long run each mode's probability is proportional
    to its duration.
    """
    count = len(modes)
    share = np.array(durations) / sum(durations)
    away = 1.0 / ((count - 1) * np.array(durations)[:, None])  # from each mode to each of the others, 1/s
    rates = away * (1.0 - count * np.eye(count))
    transition = lru_cache(maxsize=64)(lambda dt: expm(dt * rates))
    steps = [_cached_step(model) for model in models]

    def start(mean: Array, covariance: Array) -> Any:
        return multiple_model.start(modes, mean, covariance, share)

    def predict(state: Any, dt: float, attitude_error: AttitudeErrorModel, errors: ReportErrors) -> Any:
        each = [with_report_errors(step(dt), errors, attitude_error) for step in steps]
        processes, noises = [_process(s) for s in each], [s.Q for s in each]
        return multiple_model.predict(modes, state, processes, noises, transition(dt))

    def update(state: Any, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]) -> Update:
        return Update(*multiple_model.update(modes, state, y, [measure] * count, R, angular)[:5])

    def belief(state: Any) -> Belief:
        return multiple_model.belief(modes, state)

    def change(state: Any, f: Callable[[Belief], Belief]) -> Any:
        each = zip(modes, state.states, strict=True)
        return state._replace(states=tuple(mode.start(*f(mode.belief(one))) for mode, one in each))

    return TrackFilter(start, predict, update, belief, change, polar=True)


def _process(step: motion.MotionStep) -> Rows:
    return lambda rows: motion.propagate(rows, step)


def _cached_step(model: motion.MotionModel) -> Callable[[float], motion.MotionStep]:
    """Return the model's step with a cache, since few different `dt` occur."""
    return lru_cache(maxsize=64)(lambda dt: motion.step(dt, model))


def take(state: Any, rows: Places) -> Any:
    """Return the state of some tracks."""
    return _over(lambda a: np.ascontiguousarray(a[rows]), state)


def put(state: Any, rows: Places, part: Any) -> Any:
    """Return a copy of the state with the state of some tracks replaced."""

    def replaced(a: Array, b: Array) -> Array:
        c = a.copy()
        c[rows] = b
        return c

    return _over(replaced, state, part)


def join(state: Any, more: Any) -> Any:
    """Return one state of the tracks of two."""
    return _over(lambda a, b: np.concatenate([a, b]), state, more)


def _over(f: Callable[..., Any], *states: Any) -> Any:
    """Return the state with `f` applied to each array of the states."""
    if isinstance(states[0], np.ndarray):
        return f(*states)
    parts = [_over(f, *same) for same in zip(*states, strict=True)]
    return type(states[0])(*parts) if hasattr(states[0], "_fields") else tuple(parts)
