"""Filters of all tracks in one batch at one time.

If one covariance is lost, the batch is computed filter by filter: only the failing one is reported, and the others
continue.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.filter import TrackFilter, join, put, take
from onboard.filters.association import Places
from onboard.filters.belief import Belief, FilterError, Update
from onboard.models.intruder import measurement
from onboard.models.intruder.attitude_error import AttitudeErrorModel, ReportErrors, correct_attitude_error
from onboard.models.intruder.motion import STATE_SIZE, earlier_position
from onboard.units import NS_PER_S, S_PER_NS

NO_ROWS: Final = np.zeros(0, np.int64)
Measure = Callable[[Array, Places], Array]  # arguments: rows of states, and the place of each row's measurement


class Radar(NamedTuple):
    """A radar's position r_OR_n (3,) and attitude R_rn (3, 3)."""

    r: Array
    R_rn: Array


class Batch:
    """The filters of `size` tracks, all at `t_ns`."""

    def __init__(self, tracks: TrackFilter) -> None:
        self.t_ns = 0
        self.size = 0
        self.polar = tracks.polar
        self._filter = tracks
        self._state: Any = None
        self._belief: Belief | None = None

    def add(self, belief: Belief) -> None:
        """Add a track with mean (15,) and covariance (15, 15). Raises FilterError."""
        state = self._filter.start(belief.mean[None], belief.covariance[None])
        self._set(state if self.size == 0 else join(self._state, state))
        self.size += 1

    def keep(self, rows: Places) -> None:
        """Remove all tracks but these."""
        if len(rows) < self.size:
            self._set(take(self._state, rows))
            self.size = len(rows)

    def clear(self) -> None:
        """Remove all tracks, and the time."""
        self.t_ns = self.size = 0
        self._set(None)

    def lag(self, t_ns: int) -> float:
        """Return how much older than the filters a time is, s; negative if it is newer."""
        return (self.t_ns - t_ns) / NS_PER_S

    def belief(self) -> Belief:
        """Return mean (size, 15) and covariance (size, 15, 15)."""
        if self.size == 0:
            return Belief(np.zeros((0, STATE_SIZE)), np.zeros((0, STATE_SIZE, STATE_SIZE)))
        if self._belief is None:
            self._belief = self._filter.belief(self._state)
        return self._belief

    def position(self, row: int, t_ns: int) -> Array:
        """Return the position (3,) of a track at a time that may be before the filters'."""
        return np.asarray(earlier_position(self.belief().mean[[row]], np.array([self.lag(t_ns)]))[0])

    def advance(self, t_ns: int, attitude_error: AttitudeErrorModel, report_errors: ReportErrors) -> Places:
        """Predict all tracks to a time, never back, with their common errors.

        Returns the rows of tracks whose filter failed; these do not change.
        """
        dt = (t_ns - self.t_ns) * S_PER_NS
        if dt <= 0:
            return NO_ROWS
        self.t_ns = t_ns
        if self.size == 0:
            return NO_ROWS
        try:
            self._set(self._filter.predict(self._state, dt, attitude_error, report_errors))
        except FilterError:
            return self._predict_singly(dt, attitude_error, report_errors)
        return NO_ROWS

    def evaluate_reports(self, rows: Places, lag: Array, y: Array, R: Array, bias_sigma: Array) -> Update:
        """Evaluate reports y (k, 6) with noise R (k, 6, 6) for the tracks in these rows (k,).

        They are `lag` (k,) seconds old, and their steady errors have standard deviations `bias_sigma` (k, 3).
        """
        report = lambda points, at: measurement.report(points, lag[at], bias_sigma[at])  # noqa: E731 - a model
        return self._evaluate(rows, y, R, report, ())

    def evaluate_echoes(self, rows: Places, lag: float, y: Array, sigma: Array, radar: Radar) -> Update:
        """Evaluate echoes y (k, 3), range, azimuth, elevation, with standard deviations (k, 3).

        They are `lag` seconds old.
        """
        if self.polar:
            R = sigma[:, :, None] ** 2 * np.eye(3)
            echo = lambda points, at: measurement.echo(points, np.full(len(at), lag), *radar)  # noqa: E731 - a model
            return self._evaluate(rows, y, R, echo, measurement.POLAR_ANGULAR)
        R = measurement.position_noise(y, sigma, radar.R_rn)
        position = lambda points, at: earlier_position(points, np.full(len(at), lag))  # noqa: E731 - a model
        return self._evaluate(rows, measurement.position(y, *radar), R, position, ())

    def apply(self, rows: Places, updates: Update, chosen: Places) -> None:
        """Apply the updates `chosen`, which are of tracks `rows[chosen]`."""
        if len(chosen):
            self._put(rows[chosen], take(updates.belief, chosen))

    def restart(self, row: int, belief: Belief) -> None:
        """Restart a track with mean (15,) and covariance (15, 15)."""
        self._put(np.array([row]), self._filter.start(belief.mean[None], belief.covariance[None]))

    def correct_attitude_error(self, rotation: Belief) -> None:
        """Correct all tracks after registration has found the attitude error.

        The rotation has mean (3,) and covariance (3, 3). Filters of Cartesian positions do not estimate it.
        """
        if self.size and self.polar:
            self._set(self._filter.change(self._state, lambda b: correct_attitude_error(b, rotation)))

    def _put(self, rows: Places, part: Any) -> None:
        """Replace the state of some tracks, and only their part of a known belief."""
        known = self._belief
        self._set(put(self._state, rows, part))
        if known is not None:
            self._belief = put(known, rows, self._filter.belief(part))

    def _set(self, state: Any) -> None:
        self._state = state
        self._belief = None

    def _evaluate(self, rows: Places, y: Array, R: Array, measure: Measure, angular: tuple[int, ...]) -> Update:
        """Evaluate all measurements at once; if that fails, one by one, and a NIS of NaN is a failed filter."""
        state, every = take(self._state, rows), np.arange(len(y))
        try:
            return self._evaluate_at(state, every, y, R, measure, angular)
        except FilterError:
            nan = np.full((1, y.shape[1]), np.nan)
            failed = (nan, np.full((1, y.shape[1], y.shape[1]), np.nan), nan, np.full(1, np.nan))

        def evaluate(one: Any, i: int) -> tuple[Any, ...]:
            at = every[i : i + 1]
            try:
                return self._evaluate_at(one, at, y[at], R[at], measure, angular)[:5]
            except FilterError:
                return one, *failed

        return Update(*_singly(evaluate, state, len(y)))

    def _evaluate_at(
        self, state: Any, at: Places, y: Array, R: Array, measure: Measure, angular: tuple[int, ...]
    ) -> Update:
        over_rows = lambda points: measure(points, np.repeat(at, len(points) // len(at)))  # noqa: E731 - a model
        update = self._filter.update(state, y, over_rows, R, angular)
        return update._replace(nis=np.asarray(update.nis))

    def _predict_singly(self, dt: float, attitude_error: AttitudeErrorModel, errors: ReportErrors) -> Places:
        failed: list[int] = []

        def predict(one: Any, i: int) -> Any:
            try:
                return self._filter.predict(one, dt, attitude_error, take(errors, np.array([i])))
            except FilterError:
                failed.append(i)
                return one

        self._set(_singly(predict, self._state, self.size))
        return np.array(failed, np.int64)


def _singly(step: Callable[[Any, int], Any], state: Any, count: int) -> Any:
    """Apply `step` to each track's state and number, and join the results."""
    whole = step(take(state, np.array([0])), 0)
    for i in range(1, count):
        whole = join(whole, step(take(state, np.array([i])), i))
    return whole
