"""All tracks' filters in one batch, at one time: prediction, judgement and correction of any of them.

A filter whose covariance is lost (it should not happen) does not take the others with it: the batch is then done
filter by filter, and whichever fails is told.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from onboard.estimators._traffic_filter import Choice, join, put, take
from onboard.filters.association import Places
from onboard.filters.belief import Belief, FilterError, Update
from onboard.geometry.rotations import Array
from onboard.models import intruder


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
        """One more track, with mean (12,) and covariance (12, 12). Raises FilterError."""
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
        """Mean (size, 12) and covariance (size, 12, 12)."""
        if self.size == 0:
            return Belief(np.zeros((0, intruder.N)), np.zeros((0, intruder.N, intruder.N)))
        if self._belief is None:
            self._belief = self._choice.belief(self._state)
        return self._belief

    def advance(self, t_ns: int) -> Places:
        """Predict all to a time, never back; the rows of tracks whose filter failed, which stay as they were."""
        dt = (t_ns - self.t_ns) * 1e-9
        if dt <= 0:
            return np.zeros(0, np.int64)
        self.t_ns = t_ns
        if self.size == 0:
            return np.zeros(0, np.int64)
        try:
            self._set(self._choice.predict(self._state, dt))
        except FilterError:
            return self._one_by_one(lambda one: self._choice.predict(one, dt))
        return np.zeros(0, np.int64)

    def judge_reports(self, rows: Places, lag: Array, y: Array, R: Array) -> Judged:
        """Reports y (k, 6) with noise R (k, 6, 6), `lag` (k,) seconds old, of the tracks in these rows (k,)."""
        return self._judge(rows, lag, y, R, intruder.reported, ())

    def judge_echoes(self, rows: Places, lag: float, y: Array, sigma: Array, radar: Radar) -> Judged:
        """Echoes y (k, 3): range, azimuth, elevation, with standard deviations (k, 3)."""
        lags = np.full(len(rows), lag)
        if self._choice.polar:
            R = sigma[:, :, None] ** 2 * np.eye(3)
            see = lambda points, lag: intruder.seen(points, lag, *radar)  # noqa: E731 - a model, at this radar
            return self._judge(rows, lags, y, R, see, intruder.POLAR_ANGULAR)
        R = intruder.position_noise(y, sigma, radar.R_rn)
        return self._judge(rows, lags, intruder.position(y, *radar), R, intruder.located, ())

    def correct(self, rows: Places, judged: Judged, chosen: Places) -> None:
        """Take in the judged measurements at the places `chosen`, which are of tracks `rows[chosen]`."""
        if len(chosen):
            self._set(put(self._state, rows[chosen], take(judged.state, chosen)))

    def restart(self, row: int, mean: Array, covariance: Array) -> None:
        """Begin a track anew."""
        self._set(put(self._state, np.array([row]), self._choice.start(mean[None], covariance[None])))

    def _set(self, state: Any) -> None:
        self._state = state
        self._belief = None

    def _judge(
        self,
        rows: Places,
        lag: Array,
        y: Array,
        R: Array,
        model: Callable[[Array, Array], Array],
        angular: tuple[int, ...],
    ) -> Judged:
        state = take(self._state, rows)
        try:
            update = self._update(state, lag, y, R, model, angular)
        except FilterError:
            return self._judge_singly(state, lag, y, R, model, angular)
        return _judged(update)

    def _update(
        self,
        state: Any,
        lag: Array,
        y: Array,
        R: Array,
        model: Callable[[Array, Array], Array],
        angular: tuple[int, ...],
    ) -> Update:
        measure = lambda points: model(points, np.repeat(lag, len(points) // len(lag)))  # noqa: E731 - over rows
        return self._choice.update(state, y, measure, R, angular)

    def _judge_singly(
        self,
        state: Any,
        lag: Array,
        y: Array,
        R: Array,
        model: Callable[[Array, Array], Array],
        angular: tuple[int, ...],
    ) -> Judged:
        parts: list[Judged] = []
        m = y.shape[1]
        for i in range(len(y)):
            at = np.array([i])
            one = take(state, at)
            try:
                parts.append(_judged(self._update(one, lag[at], y[at], R[at], model, angular)))
            except FilterError:
                nothing = np.full((1, m), np.nan)
                parts.append(Judged(one, nothing, np.full((1, m, m), np.nan), nothing, np.full(1, np.nan)))
        whole = parts[0]
        for part in parts[1:]:
            whole = join(whole, part)
        return whole

    def _one_by_one(self, step: Callable[[Any], Any]) -> Places:
        failed, states = [], None
        for i in range(self.size):
            one = take(self._state, np.array([i]))
            try:
                one = step(one)
            except FilterError:
                failed.append(i)
            states = one if states is None else join(states, one)
        self._set(states)
        return np.array(failed, np.int64)


def _judged(update: Update) -> Judged:
    return Judged(
        update.belief, update.innovation, update.innovation_covariance, update.predicted, np.asarray(update.nis)
    )
