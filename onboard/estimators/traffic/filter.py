"""The filters a tracker may use, all tracks in one batch: any of `onboard.filters`, called alike.

state = choice.predict(state, dt, turning, reports)
part = take(state, rows)                        # of some tracks
state = put(state, rows, update.belief)
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from scipy.linalg import expm

from onboard.arrays import Array
from onboard.filters import extended, kalman, multiple_model, square_root, unscented
from onboard.filters.association import Places
from onboard.filters.belief import Belief, Method, Rows, Update
from onboard.models import intruder

FilterName = Literal["kf", "ekf", "ukf", "srukf", "imm"]
SINGLE: Final[dict[str, Method]] = {
    "kf": kalman.METHODS[0],
    "ekf": extended.METHODS[0],
    "ukf": unscented.METHODS[0],
    "srukf": square_root.METHODS[0],
}


class Choice(NamedTuple):
    """A filter over tracks, as `onboard.filters.Method`, but that `predict(state, dt, turning, reports)` knows the
    model; `reports` are those that the tracks have heard.
    `change(state, f)` is the state with `f` of its beliefs in their places, however many it has of each track.
    `polar`: whether it takes a radar's measurements as they are, or only Cartesian ones."""

    start: Callable[[Array, Array], Any]
    predict: Callable[[Any, float, intruder.Turning, intruder.Reports], Any]
    update: Callable[[Any, Array, Rows, Array, tuple[int, ...]], Update]
    belief: Callable[[Any], Belief]
    change: Callable[[Any, Callable[[Belief], Belief]], Any]
    polar: bool


def choose(name: FilterName, noises: Sequence[intruder.Noise], lasts: Sequence[float]) -> Choice:
    """The filter of that name. The mixture of extended filters has all the `noises`, each of which `lasts` so many
    seconds on average; single filters have that of the last one."""
    if name == "imm":
        return _mixture((extended.METHODS[0],) * len(noises), noises, lasts)
    method, step = SINGLE[name], _remembering(noises[-1])

    def predict(state: Any, dt: float, turning: intruder.Turning, reports: intruder.Reports) -> Any:
        then = intruder.with_reports(step(dt), reports, turning)
        return method.predict(state, _mover(then), then.Q)

    def change(state: Any, f: Callable[[Belief], Belief]) -> Any:
        return method.start(*f(method.belief(state)))

    return Choice(method.start, predict, method.update, method.belief, change, name != "kf")


def _mixture(modes: Sequence[Method], noises: Sequence[intruder.Noise], lasts: Sequence[float]) -> Choice:
    """Interacting filters, a mode each, that differ in how freely the aircraft accelerates. A mode passes to any
    other, so in the long run an aircraft is in each for as large a share of time as it lasts."""
    count = len(modes)
    share = np.array(lasts) / sum(lasts)
    away = 1.0 / ((count - 1) * np.array(lasts)[:, None])  # from each to each of the others, a second
    rates = away * (1.0 - count * np.eye(count))
    passing = lru_cache(maxsize=64)(lambda dt: expm(dt * rates))
    steps = [_remembering(noise) for noise in noises]

    def start(mean: Array, covariance: Array) -> Any:
        return multiple_model.start(modes, mean, covariance, share)

    def predict(state: Any, dt: float, turning: intruder.Turning, reports: intruder.Reports) -> Any:
        each = [intruder.with_reports(step(dt), reports, turning) for step in steps]
        return multiple_model.predict(modes, state, [_mover(s) for s in each], [s.Q for s in each], passing(dt))

    def update(state: Any, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]) -> Update:
        return Update(*multiple_model.update(modes, state, y, [measure] * count, R, angular)[:5])

    def belief(state: Any) -> Belief:
        return multiple_model.belief(modes, state)

    def change(state: Any, f: Callable[[Belief], Belief]) -> Any:
        each = zip(modes, state.states, strict=True)
        return state._replace(states=tuple(mode.start(*f(mode.belief(one))) for mode, one in each))

    return Choice(start, predict, update, belief, change, polar=True)


def _mover(step: intruder.Step) -> Rows:
    return lambda rows: intruder.moved(rows, step)


def _remembering(noise: intruder.Noise) -> Callable[[float], intruder.Step]:
    """The model's step, kept for the few lengths there are."""
    return lru_cache(maxsize=64)(lambda dt: intruder.step(dt, noise))


# ------------------------------------------------------------------- states are trees of arrays (tracks, ...)


def over(f: Callable[..., Any], *states: Any) -> Any:
    """A state of `f` of each array of states alike."""
    if isinstance(states[0], np.ndarray):
        return f(*states)
    parts = [over(f, *same) for same in zip(*states, strict=True)]
    return type(states[0])(*parts) if hasattr(states[0], "_fields") else tuple(parts)


def take(state: Any, rows: Places) -> Any:
    """The state of some tracks."""
    return over(lambda a: np.ascontiguousarray(a[rows]), state)


def put(state: Any, rows: Places, part: Any) -> Any:
    """The state with that of some tracks replaced."""

    def replaced(a: Array, b: Array) -> Array:
        c = a.copy()
        c[rows] = b
        return c

    return over(replaced, state, part)


def join(state: Any, more: Any) -> Any:
    """The state of these tracks and those."""
    return over(lambda a, b: np.concatenate([a, b]), state, more)
