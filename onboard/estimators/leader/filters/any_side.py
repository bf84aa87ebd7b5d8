"""The filter we fly: the wing-line filter, believed only as far as a second filter that assumes less agrees.

The wing-line filter is sharp, but it takes the nose to be on the course: seen from any other side it is sure of a
wrong range. The cloud of noses assumes nothing of the kind. Both follow the same images. Where the cloud knows the
range and both agree, the estimate is the wing-line filter's, no surer of the range than the cloud is. Elsewhere
the estimate is mean and covariance of the whole cloud, and the reason says what is open.

The cloud takes an image every 150 ms at most: what it has to find out changes slowly, and it costs more. Where
images come often and the estimate is the wing-line filter's, it takes one only after the estimate with that image
is published (`AnySideFilter.finish`), so that none is late. Such an image counts for the cloud from the next one
on, or once the cloud has to be predicted: that depends on the images' times alone, so a replay gives the same.
"""

import math
from contextlib import suppress
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.filter import LeaderFilter, Measurement, Open
from onboard.estimators.leader.filters.noses import evidence, particles
from onboard.estimators.leader.filters.noses.cloud import Cloud
from onboard.estimators.leader.filters.noses.moments import NOSE
from onboard.estimators.leader.filters.noses.summary import MOTION, RESOLVED, Summary, as_leader, summarise
from onboard.estimators.leader.filters.partial import with_wing
from onboard.estimators.leader.filters.postponed import Pending, Postponed, standing
from onboard.estimators.leader.settings import NoseModel
from onboard.estimators.leader.shape import Shape
from onboard.estimators.leader.sight import Sight, sight
from onboard.estimators.leader.size import Size
from onboard.estimators.leader.wind import Wind
from onboard.filters.belief import Belief, FilterError, Update
from onboard.models.leader_flight import HEADING
from onboard.models.relative_motion import R
from onboard.ownship import Step

PERIOD_S: Final = 0.15  # between images that the cloud takes
LONGEST_S: Final = 0.25  # of a prediction of the cloud
OFTEN_S: Final = 0.2  # since the cloud's last image, where images come often
AGREE: Final = 1.0  # sigmas of the cloud's range: it confirms a wing-line range that is no farther off
AGREE_AT_LEAST: Final = 0.025  # of the range: so near a range is confirmed in any case
ON_COURSE: Final = math.radians(15.0)  # rad, of the nose about the course: the wing-line filter supposes so
TOO_WIDE: Final = 0.2  # rad, of the direction: a cloud that is less certain starts again
ANOTHER: Final = 0.05  # of the size: so wrong a one misleads the wing-line filter
PATIENCE: Final = 10  # images in a row that the wing-line filter may reject before it starts again


class Taken(NamedTuple):
    """The cloud and its summary after an image, whether it confirms the wing-line filter, and whether it expected
    the image: otherwise they are those before it."""

    cloud: Cloud
    summary: Summary
    confirmed: bool
    expected: bool


class AnySide(NamedTuple):
    """Both filters' states, a `summary` of the cloud at its time (of a little earlier, and carried on), how many
    images the wing-line filter has rejected in a row: it is not believed meanwhile; whether the cloud, at its last
    image, confirmed it; the size, if it is no longer the configured one; and whether the wing-line filter has
    flown with quite another one, so that it starts again; the wind, if it matters and is known; what the cloud
    becomes by an image that it has yet to take, with our own motion since that image; and how long ago, s, the
    cloud's last image is."""

    wing_line: Any
    cloud: Cloud
    summary: Summary
    pending: Pending
    rejected: int
    confirmed: bool
    size: Size | None = None
    outdated: bool = False
    wind: Wind | None = None
    postponed: Postponed[Taken] | None = None
    since: Pending | None = None
    waited: float = 0.0


class AnySideFilter:
    """See `filter.LeaderFilter`."""

    def __init__(self, wing_line: LeaderFilter, settings: NoseModel, shape: Shape) -> None:
        self.shape: Shape | None = shape
        self.components, self.units = wing_line.components, wing_line.units
        self.measured_components, self.measured_units = wing_line.measured_components, wing_line.measured_units
        self.gate = wing_line.gate
        self._wing_line, self._settings = wing_line, settings

    def measure(self, points: Array, sigmas: Array) -> Measurement:
        """As the wing-line filter."""
        return self._wing_line.measure(points, sigmas)

    def start(self, measurement: Measurement, pose: CameraPose, before: AnySide | None) -> AnySide:
        """Both filters start. The cloud keeps of what was believed before only the noses."""
        before = None if before is None else self._caught_up(before)
        earlier = None if before is None or not before.confirmed else before.wing_line
        wind = None if before is None else before.wind
        wing_line = self._wing_line.start(with_wing(measurement), in_air(pose, wind), earlier)
        noses = None if before is None else before.cloud
        settings = particles.supposed(self._settings, None, wind)
        cloud = particles.start(settings, measurement, pose, noses)
        summary = summarise(settings, cloud)
        return AnySide(wing_line, cloud, summary, standing(pose.v_F_n), 0, False, wind=wind)

    def informed(self, state: AnySide, prior: Belief) -> AnySide | None:
        """The cloud alone is informed; it does not confirm the wing-line filter yet."""
        cloud = evidence.informed(self._settings, state.cloud, prior)
        return None if cloud is None else state._replace(cloud=cloud, summary=summarise(self._noses(state), cloud))

    def advance(self, state: AnySide, step: Step) -> AnySide:
        """The wing-line filter's prediction; the cloud is predicted when it takes an image, or after a while."""
        since = None if state.since is None else state.since.after(step)
        pending = state.pending.after(step)
        through_air = step if state.wind is None else state.wind.step(step)
        wing_line = self._wing_line.advance(state.wing_line, through_air)
        waited = state.waited + step.dt
        advanced = state._replace(wing_line=wing_line, pending=pending, waited=waited, since=since)
        if pending.dt > LONGEST_S:
            advanced = finished(advanced)  # whose cloud may be of a newer image
        return self._caught_up(advanced) if advanced.pending.dt > LONGEST_S else advanced

    def fuse(self, state: AnySide, measurement: Measurement, pose: CameraPose) -> Update:
        """Both filters' updates. An image passes if either expected it; innovation and NIS are the wing-line's."""
        gate, state = self.gate if self.gate is not None else math.inf, finished(state)
        through_air = in_air(pose, state.wind)
        try:
            update = self._wing_line.fuse(state.wing_line, measurement, through_air)
            is_seen = sight(measurement.axes, pose).shows(self._wing_line.belief(update.belief).mean[R])
            passes, wing_line = bool(update.nis <= gate) and is_seen, update.belief
        except FilterError:
            if not state.rejected:
                raise
            update = self._wing_line.fuse(self._anew(state, measurement, pose), measurement, through_air)
            passes, wing_line = False, None
        rejected = 0 if passes else state.rejected + 1
        has_extent = measurement.has_extent  # else it is a direction, and nothing starts from it
        outdated = state.outdated and not has_extent
        if (rejected > PATIENCE or state.outdated) and has_extent:
            wing_line, rejected = self._anew(state, measurement, pose), 0
        elif not passes:
            wing_line = state.wing_line
        after = state._replace(wing_line=wing_line, rejected=rejected, outdated=outdated)
        usual = passes and not state.rejected
        if usual and state.waited < PERIOD_S:
            return update._replace(belief=after)
        take = partial(self._take, after, measurement, pose, restarts=passes and has_extent)
        after = after._replace(waited=0.0)
        if usual and state.confirmed and measurement.is_plain and state.waited < OFTEN_S:
            return update._replace(belief=after._replace(postponed=Postponed(take), since=standing(pose.v_F_n)))
        taken = take()
        after = with_cloud(after, taken, standing(pose.v_F_n))
        if not taken.expected:
            return update._replace(belief=after)
        return update._replace(belief=after, nis=min(update.nis, gate), misfits=taken.cloud.misfits)

    def finish(self, state: AnySide) -> None:
        """Let the cloud take an image that it has postponed. If that fails, it fails again when it is needed."""
        if state.postponed is not None:
            with suppress(FilterError):
                state.postponed.value()

    def _take(self, state: AnySide, measurement: Measurement, pose: CameraPose, *, restarts: bool) -> Taken:
        """The cloud after an image; one that is too wide starts again with it, if it `restarts`."""
        settings, predicted = self._noses(state), self._caught_up(state)
        if restarts and predicted.summary.direction_sigma() > TOO_WIDE:
            cloud, nis = particles.start(settings, measurement, pose, predicted.cloud), 0.0
        else:
            cloud, nis = particles.update(settings, predicted.cloud, measurement, pose)
        expected = nis <= settings.gate
        if expected:
            predicted = predicted._replace(cloud=cloud, summary=summarise(settings, cloud))
        return Taken(predicted.cloud, predicted.summary, self._agree(predicted), expected)

    def resized(self, state: AnySide, size: Size) -> AnySide:
        """Both filters' states for another size."""
        state = self._caught_up(state)
        ratio = size.value / self._noses(state).size
        cloud = state.cloud
        if not cloud.metric:
            cloud = particles.rescaled(state.cloud, ratio, state.pending.v_F_n)
        wing_line = self._wing_line.resized(state.wing_line, size)
        outdated = state.outdated or abs(math.log(ratio)) > ANOTHER
        after = state._replace(wing_line=wing_line, cloud=cloud, size=size, outdated=outdated)
        after = after._replace(summary=summarise(self._noses(after), cloud))
        return after._replace(confirmed=self._agree(after))

    def in_wind(self, state: AnySide, wind: Wind) -> AnySide:
        """The state in another wind, which says of a fixed wing where its nose points."""
        if self._settings.crab == 0.0:
            return state
        after = self._caught_up(state)._replace(wind=wind if wind.is_known else None)
        after = after._replace(summary=summarise(self._noses(after), after.cloud))
        return after._replace(confirmed=self._agree(after))

    def belief(self, state: AnySide) -> Belief:
        """The wing-line filter's belief, no surer of motion and nose than the cloud; or that of the cloud."""
        sharp = self._wing_line.belief(state.wing_line)
        whole = as_leader(state.summary, *state.pending, sharp)
        if not state.confirmed:
            return whole
        off = sharp.mean - whole.mean
        covariance = sharp.covariance.copy()
        covariance[MOTION, MOTION] = whole.covariance[MOTION, MOTION] + off[MOTION, None] * off[MOTION]
        covariance[MOTION, 6:], covariance[6:, MOTION] = 0.0, 0.0
        aside = math.remainder(off[HEADING], math.tau if state.cloud.sided else math.pi)
        covariance[HEADING, :], covariance[:, HEADING] = 0.0, 0.0
        covariance[HEADING, HEADING] = whole.covariance[HEADING, HEADING] + aside * aside
        return Belief(sharp.mean, covariance)

    def predicted_points(
        self, state: AnySide, measurement: Measurement, update: Update, pose: CameraPose
    ) -> Array:
        """As the wing-line filter."""
        return self._wing_line.predicted_points(state.wing_line, measurement, update, in_air(pose, state.wind))

    def open_question(self, state: AnySide) -> Open:
        """What the images leave open, and if it is the range, the modes of the cloud."""
        known, is_metric = state.summary, state.cloud.metric
        if known.range_sigma() > RESOLVED:
            dt, moved, v_F_n = state.pending
            places = tuple(place.after(dt, moved).relative_to(v_F_n) for place in known.places)
            why = "" if is_metric else "heading not resolved: "
            return Open(f"{why}the range is uncertain", places, is_metric)
        return Open("" if state.confirmed or is_metric else "the nose is not on the course", (), is_metric)

    def is_too_wide(self, state: AnySide, share: float) -> bool:
        """Whether the direction is less certain than `share` to both; an uncertain range is no obstacle to it.
        A cloud that alone is too wide starts again with an image that the wing-line filter expected."""
        known = state.summary.after(state.pending.dt, state.pending.moved)
        return known.direction_sigma() > share and self._wing_line.is_too_wide(state.wing_line, share)

    def _agree(self, state: AnySide) -> bool:
        """Whether the cloud, caught up, knows the range, and the wing-line filter has the same one."""
        known, sigma = state.summary, state.summary.range_sigma()
        air = self._noses(state).air
        if state.rejected or state.outdated or sigma > RESOLVED or not known.is_on_course(ON_COURSE, air):
            return False
        sharp, now = self._wing_line.belief(state.wing_line).mean, known.mean
        if not Sight(now[R] / np.linalg.norm(now[R]), np.zeros(3)).shows(sharp[R]):  # as far, but elsewhere
            return False
        if state.cloud.sided and math.cos(sharp[HEADING] - now[NOSE]) < 0.0:  # it takes the tail for the nose
            return False
        ratio = math.log(float(np.linalg.norm(sharp[R])) / float(np.linalg.norm(now[R])))
        return abs(ratio) < max(AGREE * sigma, AGREE_AT_LEAST)

    def _noses(self, state: AnySide) -> NoseModel:
        """What the cloud assumes, with the size and the wind as they are known now."""
        return particles.supposed(self._settings, state.size, state.wind)

    def _anew(self, state: AnySide, measurement: Measurement, pose: CameraPose) -> Any:
        """The wing-line filter's state after a first image."""
        started = self._wing_line.start(with_wing(measurement), in_air(pose, state.wind), None)
        return started if state.size is None else self._wing_line.resized(started, state.size)

    def _caught_up(self, state: AnySide) -> AnySide:
        """The cloud predicted to the wing-line filter's time, with every image that it had to take."""
        state = finished(state)
        dt, moved, v_F_n = state.pending
        if dt <= 0.0:
            return state
        settings = self._noses(state)
        cloud = particles.predict(settings, state.cloud, dt, moved)
        pending = standing(v_F_n)
        if dt > LONGEST_S:  # no image corrects it soon
            return state._replace(cloud=cloud, summary=summarise(settings, cloud), pending=pending)
        return state._replace(cloud=cloud, summary=state.summary.after(dt, moved), pending=pending)


def finished(state: AnySide) -> AnySide:
    """The state with every image that the cloud had to take."""
    if state.postponed is None or state.since is None:
        return state
    return with_cloud(state, state.postponed.value(), state.since)


def with_cloud(state: AnySide, taken: Taken, since: Pending) -> AnySide:
    """The state with what the cloud has become by an image, and our own motion `since` then."""
    cloud, summary, confirmed, _ = taken
    known = state._replace(cloud=cloud, summary=summary, confirmed=confirmed)
    return known._replace(pending=since, postponed=None, since=None)


def in_air(pose: CameraPose, wind: Wind | None) -> CameraPose:
    """The camera's pose with our velocity through the air, if the wind is known."""
    return pose if wind is None else wind.pose(pose)
