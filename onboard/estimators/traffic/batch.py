"""All tracks' filters in one batch, at one time: prediction, judgement and correction of any of them.

A filter whose covariance is lost (it should not happen) does not take the others with it: the batch is then done
filter by filter, and whichever fails is told.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.filter import Choice, join, put, take
from onboard.filters.association import Places
from onboard.filters.belief import Belief, FilterError
from onboard.models import intruder

NONE: Final = np.zeros(0, np.int64)
Model = Callable[[Array, Places], Array]  # of rows of states, and of which measurement each row is


class Radar(NamedTuple):
    """Where a radar is, (3,), and its attitude R_rn (3, 3)."""

    r: Array
    R_rn: Array


class Judged(NamedTuple):
    """What measurements say of tracks, not yet taken in: the states (tracks, ...) they would lead to, innovations
    (k, m) with covariance (k, m, m), predictions (k, m), and NIS (k,), which is NaN where a filter failed."""

    state: Any
    innovation: Array
    covariance: Array
    predicted: Array
    nis: Array


class Batch:
    """The filters of `size` tracks, all at `t_ns`."""

    def __init__(self, choice: Choice) -> None:
        self.t_ns = 0
        self.size = 0
        self.polar = choice.polar
        self._choice = choice
        self._state: Any = None
        self._belief: Belief | None = None

    def add(self, mean: Array, covariance: Array) -> None:
        """One more track, with mean (15,) and covariance (15, 15). Raises FilterError."""
        state = self._choice.start(mean[None], covariance[None])
        self._set(state if self.size == 0 else join(self._state, state))
        self.size += 1

    def keep(self, rows: Places) -> None:
        """Forget all tracks but these."""
        if len(rows) < self.size:
            self._set(take(self._state, rows))
            self.size = len(rows)

    def clear(self) -> None:
        """Forget all, and the time."""
        self.t_ns = self.size = 0
        self._set(None)

    def belief(self) -> Belief:
        """Mean (size, 15) and covariance (size, 15, 15)."""
        if self.size == 0:
            return Belief(np.zeros((0, intruder.N)), np.zeros((0, intruder.N, intruder.N)))
        if self._belief is None:
            self._belief = self._choice.belief(self._state)
        return self._belief

    def advance(self, t_ns: int, turning: intruder.Turning, reports: intruder.Reports) -> Places:
        """Predict all to a time, never back; the rows of tracks whose filter failed, which stay as they were. What
        turns, and the reports that all have heard, are `Choice.predict`'s."""
        dt = (t_ns - self.t_ns) * 1e-9
        if dt <= 0:
            return np.zeros(0, np.int64)
        self.t_ns = t_ns
        if self.size == 0:
            return np.zeros(0, np.int64)
        try:
            self._set(self._choice.predict(self._state, dt, turning, reports))
        except FilterError:
            return self._predict_singly(dt, turning, reports)
        return np.zeros(0, np.int64)

    def judge_reports(self, rows: Places, lag: Array, y: Array, R: Array, bias: Array) -> Judged:
        """Reports y (k, 6) with noise R (k, 6, 6), `lag` (k,) seconds old and steadily off by about `bias` (k, 3),
        of the tracks in these rows (k,)."""
        said = lambda points, which: intruder.reported(points, lag[which], bias[which])  # noqa: E731 - a model
        return self._judge(rows, y, R, said, ())

    def judge_echoes(self, rows: Places, lag: float, y: Array, sigma: Array, radar: Radar) -> Judged:
        """Echoes y (k, 3): range, azimuth, elevation, with standard deviations (k, 3)."""
        if self._choice.polar:
            R = sigma[:, :, None] ** 2 * np.eye(3)
            see = lambda points, which: intruder.seen(points, np.full(len(which), lag), *radar)  # noqa: E731 - as above
            return self._judge(rows, y, R, see, intruder.POLAR_ANGULAR)
        R = intruder.position_noise(y, sigma, radar.R_rn)
        there = lambda points, which: intruder.located(points, np.full(len(which), lag))  # noqa: E731 - as above
        return self._judge(rows, intruder.position(y, *radar), R, there, ())

    def correct(self, rows: Places, judged: Judged, chosen: Places) -> None:
        """Take in the judged measurements at the places `chosen`, which are of tracks `rows[chosen]`."""
        if len(chosen):
            self._put(rows[chosen], take(judged.state, chosen))

    def restart(self, row: int, mean: Array, covariance: Array) -> None:
        """Begin a track anew."""
        self._put(np.array([row]), self._choice.start(mean[None], covariance[None]))

    def registered(self, rotation: Belief) -> None:
        """The rotation of all that a radar sees has become known, (3,) and (3, 3)."""
        if self.size and self.polar:
            self._set(self._choice.change(self._state, lambda b: intruder.told_turned(b, rotation)))

    def _put(self, rows: Places, part: Any) -> None:
        """The state of some tracks; what is believed of the others is as it was."""
        known = self._belief
        self._set(put(self._state, rows, part))
        if known is not None:
            self._belief = put(known, rows, self._choice.belief(part))

    def _set(self, state: Any) -> None:
        self._state = state
        self._belief = None

    def _judge(self, rows: Places, y: Array, R: Array, model: Model, angular: tuple[int, ...]) -> Judged:
        """All at once; should that fail, one by one."""
        state, every = take(self._state, rows), np.arange(len(y))
        try:
            return self._judge_these(state, every, y, R, model, angular)
        except FilterError:
            nothing = np.full((1, y.shape[1]), np.nan)
            no_answer = (nothing, np.full((1, y.shape[1], y.shape[1]), np.nan), nothing, np.full(1, np.nan))

        def judge(one: Any, i: int) -> Judged:
            at = every[i : i + 1]
            try:
                return self._judge_these(one, at, y[at], R[at], model, angular)
            except FilterError:
                return Judged(one, *no_answer)

        judged: Judged = _singly(judge, state, len(y))
        return judged

    def _judge_these(
        self, state: Any, which: Places, y: Array, R: Array, model: Model, angular: tuple[int, ...]
    ) -> Judged:
        measure = lambda points: model(points, np.repeat(which, len(points) // len(which)))  # noqa: E731 - over rows
        update = self._choice.update(state, y, measure, R, angular)
        nis = np.asarray(update.nis)
        return Judged(update.belief, update.innovation, update.innovation_covariance, update.predicted, nis)

    def _predict_singly(self, dt: float, turning: intruder.Turning, reports: intruder.Reports) -> Places:
        failed: list[int] = []

        def predict(one: Any, i: int) -> Any:
            try:
                return self._choice.predict(one, dt, turning, take(reports, np.array([i])))
            except FilterError:
                failed.append(i)
                return one

        self._set(_singly(predict, self._state, self.size))
        return np.array(failed, np.int64)


def _singly(step: Callable[[Any, int], Any], state: Any, count: int) -> Any:
    """What `step` makes of each track's state, and its number, alone: as one again."""
    whole = step(take(state, np.array([0])), 0)
    for i in range(1, count):
        whole = join(whole, step(take(state, np.array([i])), i))
    return whole
