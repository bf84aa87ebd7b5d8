"""One belief about one leader: weighted hypotheses with a Gaussian each (`noses`).

Each hypothesis supposes where the leader's nose points, whether it flies steadily, accelerates or hovers, and how
boldly; all share the errors of our own state, which are considered and not estimated. Every image corrects every
hypothesis, and what they expected together is what an image is judged by. As many are kept as there are different
noses and ranges in question.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.auxiliary import Auxiliary
from onboard.estimators.leader.filters.measurement import Measurement, measure_wing
from onboard.estimators.leader.filters.noses import evidence, particles
from onboard.estimators.leader.filters.noses.cloud import Cloud
from onboard.estimators.leader.filters.noses.first import start
from onboard.estimators.leader.filters.noses.moments import LOG_SIZE
from onboard.estimators.leader.filters.noses.places import OpenQuestion
from onboard.estimators.leader.filters.noses.summary import RESOLVED, Summary, as_leader, summarise
from onboard.estimators.leader.settings import NoseModel
from onboard.estimators.leader.shape import Shape
from onboard.estimators.leader.size import Size
from onboard.estimators.leader.wind import Wind
from onboard.filters.belief import Belief, FilterError, Update
from onboard.filters.gating import normalised_squared
from onboard.models import leader_flight, wing_line
from onboard.models.relative_motion import POSITION, VELOCITY
from onboard.ownship import Step

SIZES: Final = 3.0  # sigmas of the configured size
LONGEST_S: Final = 0.25  # of a prediction of the hypotheses


class Pending(NamedTuple):
    """Our own motion since some time: seconds, displacement (3,) in m and newest velocity (3,), in n."""

    dt: float
    moved: Array
    v_F_n: Array

    def after(self, step: Step) -> "Pending":
        """After another step."""
        moved = self.moved + step.dt * step.v0 + (0.5 * step.dt**2) * step.a
        return Pending(self.dt + step.dt, moved, step.v1)


def standing(v_F_n: Array) -> Pending:
    """No motion yet, at v_F_n (3,) m/s."""
    return Pending(0.0, np.zeros(3), v_F_n)


class State(NamedTuple):
    """The hypotheses at some time, and their summary; our own motion since then; and the wind, if it is known
    otherwise than by configuration."""

    cloud: Cloud
    summary: Summary
    since: Pending
    wind: Wind | None = None


class BeliefFilter:
    """A filter of one target, of this `shape`; FilterErrors pass through. An image whose NIS is above the `gate`
    is not fused. `delay_sigma` (s): of the camera's stamps; `m`: the size of a measurement."""

    components: tuple[str, ...] = leader_flight.COMPONENTS
    units: tuple[str, ...] = leader_flight.UNITS

    def __init__(self, settings: NoseModel, shape: Shape, delay_sigma: float, m: int) -> None:
        self.shape = shape
        self.measured_components, self.measured_units = wing_line.COMPONENTS[:m], wing_line.UNITS[:m]
        self.gate = settings.gate
        self._settings, self._delay_sigma, self._m = settings, delay_sigma, m

    def measure(self, points: Array, sigmas: Array) -> Measurement:
        """See `measurement.measure_wing`."""
        return measure_wing(points, sigmas, self._m)

    def start(
        self, measurement: Measurement, pose: CameraPose, before: State | None, size: Size | None = None
    ) -> State:
        """Of what was believed before, the noses are kept. `size`: as it is known by more than images."""
        wind = None if before is None else before.wind
        settings = particles.supposed(self._settings, wind)
        if size is not None:
            settings = settings._replace(size=size.value, size_sigma=size.sigma)
        cloud = start(settings, measurement, pose, None if before is None else before.cloud)
        return State(cloud, summarise(settings, cloud), standing(pose.v_F_n), wind=wind)

    def informed(self, state: State, prior: Belief) -> State | None:
        """See `evidence.informed`."""
        cloud = evidence.informed(self._settings, state.cloud, prior)
        return None if cloud is None else self._summarised(state._replace(cloud=cloud))

    def advance(self, state: State, step: Step) -> State:
        """The hypotheses are predicted when an image comes, or after a while."""
        advanced = state._replace(since=state.since.after(step))
        return self._caught_up(advanced) if advanced.since.dt > LONGEST_S else advanced

    def fuse(self, state: State, measurement: Measurement, pose: CameraPose) -> Update:
        """The update of all hypotheses."""
        if self._delay_sigma > 0.0:
            measurement = measurement.with_attitude_noise(
                self._delay_sigma**2 * np.outer(pose.omega_c, pose.omega_c)
            )
        now = self._caught_up(state)
        settings = self._noses(now)
        expected, S = particles.predicted(settings, now.cloud, measurement, pose)
        innovation, S = _ordered(measurement.y, expected) - expected, S + measurement.R
        nis = float(normalised_squared(innovation, S))
        if not math.isfinite(nis):
            raise FilterError("the hypotheses have lost their numbers")
        cloud, beyond = particles.update(settings, now.cloud, measurement, pose)
        passes = max(nis, beyond) <= settings.gate
        after = now._replace(cloud=cloud, summary=summarise(settings, cloud)) if passes else state
        return Update(after, innovation, S, expected, nis, cloud.misfits if passes else (), passes)

    def assist(self, state: State, taken: Auxiliary) -> State | None:
        """The state after what is measured beside the images; None where that contradicts it, or where what may be
        false would lead the size beyond SIZES sigmas of the configured one. Raises FilterError."""
        now = self._caught_up(state)
        is_open = now.summary.range_sigma() > RESOLVED
        cloud = particles.assist(self._noses(now), now.cloud, taken, is_open=is_open)
        if cloud is None:
            return None
        after, s = self._summarised(now._replace(cloud=cloud)), self._settings
        apart = abs(float(after.summary.mean[LOG_SIZE]) - math.log(s.size)) * s.size
        return after if taken.trusted or apart < SIZES * s.size_sigma else None

    def in_wind(self, state: State, wind: Wind) -> State:
        """The state in another wind, which shows where the nose of a fixed wing points."""
        if self._settings.crab == 0.0:
            return state
        return self._summarised(self._caught_up(state)._replace(wind=wind if wind.is_known else None))

    def belief(self, state: State) -> Belief:
        """Mean and covariance of all hypotheses."""
        belief = as_leader(state.summary, *state.since)
        late = self._delay_sigma * belief.mean[VELOCITY]
        belief.covariance[POSITION, POSITION] += np.outer(late, late)
        return belief

    def open_question(self, state: State) -> OpenQuestion:
        """Whether the range is open, and then the places where the leader may be."""
        known, is_metric = state.summary, state.cloud.metric
        if known.range_sigma() <= RESOLVED:
            return OpenQuestion("", (), is_metric)
        dt, moved, v_F_n = state.since
        places = tuple(place.after(dt, moved).relative_to(v_F_n) for place in known.places)
        why = "" if is_metric else "heading not resolved: "
        return OpenQuestion(f"{why}the range is uncertain", places, is_metric)

    def is_too_wide(self, state: State, share: float) -> bool:
        """Whether the direction is less certain than `share`; an uncertain range is no obstacle to an image."""
        return state.summary.after(state.since.dt, state.since.moved).direction_sigma() > share

    def _noses(self, state: State) -> NoseModel:
        """What the hypotheses assume, with the size and the wind as they are known now."""
        return particles.supposed(self._settings, state.wind)

    def _summarised(self, state: State) -> State:
        return state._replace(summary=summarise(self._noses(state), state.cloud))

    def _caught_up(self, state: State) -> State:
        """The hypotheses predicted to now."""
        dt, moved, v_F_n = state.since
        if dt <= 0.0:
            return state
        cloud = particles.predict(self._noses(state), state.cloud, dt, moved)
        after = state._replace(cloud=cloud, since=standing(v_F_n))
        if dt > LONGEST_S:  # no image corrects it soon
            return self._summarised(after)
        return after._replace(summary=state.summary.after(dt, moved))


def _ordered(y: Array, expected: Array) -> Array:
    """A measurement with its wingtips exchanged where that is nearer to what is expected."""
    if y[2] * expected[2] + y[3] * expected[3] >= 0.0:
        return y
    y = y.copy()
    y[2:4] *= -1.0
    return y
