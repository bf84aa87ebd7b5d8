"""The filter we fly: the wing-line filter, believed only as far as a second filter that assumes less agrees.

The wing-line filter is sharp, but it takes the nose to be on the course: seen from any other side it is sure of a
wrong range. The nose mixture assumes nothing of the kind. Both follow the same images. Where the mixture knows the
range and both agree, the estimate is the wing-line filter's, no surer of the range than the mixture is. Elsewhere
the estimate is mean and covariance of the whole mixture, and the reason says what is open.

The mixture takes an image every 90 ms at most: what it has to find out changes slowly, and it costs more.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import nose_mixture
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filter import LeaderFilter, Measurement
from onboard.estimators.leader.nose_cells import Mixture
from onboard.estimators.leader.nose_summary import Summary, as_leader, summarise
from onboard.estimators.leader.settings import NoseModel
from onboard.filters.belief import Belief, FilterError, Update
from onboard.models.relative_motion import R
from onboard.ownship import Step

PERIOD_S: Final = 0.09  # between images that the mixture takes
LONGEST_S: Final = 0.25  # of a prediction of the mixture
RESOLVED: Final = 0.15  # of the range: a mixture that is less certain leaves it open
SHARP: Final = 0.08  # of the range: a mixture that is less certain cannot confirm the wing-line filter
AGREE: Final = 1.0  # sigmas of the mixture's range: it confirms a wing-line range that is no farther off
AGREE_AT_LEAST: Final = 0.025  # of the range: so near a range is confirmed in any case
ON_COURSE: Final = math.radians(15.0)  # rad, of the nose about the course: the wing-line filter supposes so
PATIENCE: Final = 10  # images in a row that the wing-line filter may reject before it starts again
MOTION: Final = slice(0, 6)  # position and velocity


class Pending(NamedTuple):
    """Our own motion since the mixture's time: seconds, displacement (3,) in m and newest velocity (3,), in n."""

    dt: float
    moved: Array
    v_F_n: Array


class AnySide(NamedTuple):
    """Both filters' states, a `summary` of the mixture at its time, and how many images the wing-line filter has
    rejected in a row: it is not believed meanwhile."""

    wing_line: Any
    mixture: Mixture
    summary: Summary
    pending: Pending
    rejected: int


class AnySideFilter:
    """See `filter.LeaderFilter`."""

    def __init__(self, wing_line: LeaderFilter, settings: NoseModel) -> None:
        self.components, self.units = wing_line.components, wing_line.units
        self.measured_components, self.measured_units = wing_line.measured_components, wing_line.measured_units
        self.gate, self.images = wing_line.gate, wing_line.images
        self._wing_line, self._settings = wing_line, settings

    def measure(self, points: Array, sigmas: Array) -> Measurement:
        """As the wing-line filter."""
        return self._wing_line.measure(points, sigmas)

    def start(self, measurement: Measurement, pose: CameraPose, before: AnySide | None) -> AnySide:
        """Both filters start; the mixture, which does not depend on what was believed before, anew."""
        earlier = None if before is None or not self._agree(before) else before.wing_line
        wing_line = self._wing_line.start(measurement, pose, earlier)
        mixture = nose_mixture.start(self._settings, measurement, pose)
        return AnySide(
            wing_line, mixture, summarise(self._settings, mixture), Pending(0.0, np.zeros(3), pose.v_F_n), 0
        )

    def advance(self, state: AnySide, step: Step) -> AnySide:
        """The wing-line filter's prediction; the mixture is predicted when it takes an image, or after a while."""
        moved = state.pending.moved + step.dt * step.v0 + (0.5 * step.dt**2) * step.a
        pending = Pending(state.pending.dt + step.dt, moved, step.v1)
        advanced = state._replace(wing_line=self._wing_line.advance(state.wing_line, step), pending=pending)
        return self._caught_up(advanced) if pending.dt > LONGEST_S else advanced

    def fuse(self, state: AnySide, measurement: Measurement, pose: CameraPose) -> Update:
        """Both filters' updates. An image passes if either expected it; innovation and NIS are the wing-line's."""
        gate = self.gate if self.gate is not None else math.inf
        try:
            update = self._wing_line.fuse(state.wing_line, measurement, pose)
            passes, wing_line = bool(update.nis <= gate), update.belief
        except FilterError:
            if not state.rejected:
                raise
            update = self._wing_line.fuse(self._wing_line.start(measurement, pose, None), measurement, pose)
            passes, wing_line = False, None
        rejected = 0 if passes else state.rejected + 1
        if rejected > PATIENCE:
            wing_line, rejected = self._wing_line.start(measurement, pose, None), 0
        elif not passes:
            wing_line = state.wing_line
        after = state._replace(wing_line=wing_line, rejected=rejected)
        if state.pending.dt < PERIOD_S and passes and not state.rejected:
            return update._replace(belief=after)
        predicted = self._caught_up(after)
        mixture, nis = nose_mixture.update(self._settings, predicted.mixture, measurement, pose)
        if nis > self._settings.gate:
            return update._replace(belief=predicted)
        after = predicted._replace(mixture=mixture, summary=summarise(self._settings, mixture))
        return update._replace(belief=after, nis=min(update.nis, gate))

    def belief(self, state: AnySide) -> Belief:
        """The wing-line filter's belief, no surer of the range than the mixture; or that of the whole mixture."""
        sharp = self._wing_line.belief(state.wing_line)
        known = state.summary.after(state.pending.dt, state.pending.moved)
        if not self._agree(state):
            return as_leader(known, state.pending.v_F_n, sharp)
        whole = as_leader(known, state.pending.v_F_n, sharp)
        off = sharp.mean[MOTION] - whole.mean[MOTION]
        covariance = sharp.covariance.copy()
        covariance[MOTION, MOTION] = whole.covariance[MOTION, MOTION] + off[:, None] * off
        covariance[MOTION, 6:], covariance[6:, MOTION] = 0.0, 0.0
        return Belief(sharp.mean, covariance)

    def predicted_points(
        self, state: AnySide, measurement: Measurement, update: Update, pose: CameraPose
    ) -> Array:
        """As the wing-line filter."""
        return self._wing_line.predicted_points(state.wing_line, measurement, update, pose)

    def open_question(self, state: AnySide) -> str:
        """What the images leave open, for a person; "" if nothing."""
        known = state.summary
        if known.range_sigma() > RESOLVED:
            return "heading not resolved: the range is uncertain"
        return "" if self._agree(state) else "the nose is not on the course"

    def is_too_wide(self, state: AnySide, share: float) -> bool:
        """Whether the direction is less certain than `share`; an uncertain range is no obstacle to an image."""
        return state.summary.after(state.pending.dt, state.pending.moved).direction_sigma() > share

    def _agree(self, state: AnySide) -> bool:
        """Whether the mixture knows the range, and the wing-line filter has the same one."""
        known, sigma = state.summary, state.summary.range_sigma()
        if state.rejected or sigma > SHARP or not known.is_on_course(ON_COURSE):
            return False
        sharp = self._wing_line.belief(state.wing_line).mean[R]
        now = known.after(state.pending.dt, state.pending.moved).mean[R]
        ratio = math.log(float(np.linalg.norm(sharp)) / float(np.linalg.norm(now)))
        return abs(ratio) < max(AGREE * sigma, AGREE_AT_LEAST)

    def _caught_up(self, state: AnySide) -> AnySide:
        """The mixture predicted to the wing-line filter's time."""
        dt, moved, v_F_n = state.pending
        if dt <= 0.0:
            return state
        mixture = nose_mixture.predict(self._settings, state.mixture, dt, moved)
        return state._replace(
            mixture=mixture, summary=summarise(self._settings, mixture), pending=Pending(0.0, np.zeros(3), v_F_n)
        )
