"""One belief about one leader: weighted hypotheses with a Gaussian each (`particles`).

`make_filter` makes its filter.

Each hypothesis supposes where the leader's heading points, whether it flies steadily, accelerates or hovers, and
how boldly; all share the errors of our own state, which are considered and not estimated. Every image corrects
every hypothesis, and what they expected together is what an image is judged by. As many are kept as there are
different headings and ranges in question."""

import math
from typing import NamedTuple

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel, Size
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import prediction, update
from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.places import OpenQuestion
from onboard.estimators.leader.hypotheses.prediction import NOWHERE
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.hypotheses.summary import COMPONENTS, LOG_SIZE, UNITS, Summary, as_leader, summarise
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement
from onboard.estimators.leader.image.shape import Shape, shape_of
from onboard.filters.belief import Belief, Update
from onboard.models.relative_motion import POSITION, VELOCITY
from onboard.ownship import Step


class Pending(NamedTuple):
    """Our own motion since some time.

    Seconds, displacement (3,) in m and newest velocity (3,), in n."""

    dt: float
    moved: Array
    v_F_n: Array


class State(NamedTuple):
    """The hypotheses at some time, and their summary.

    Our own motion since then; and what they assume."""

    particles: Particles
    summary: Summary
    since: Pending
    settings: LeaderModel


class Prediction(NamedTuple):
    """A state, and its hypotheses predicted to the newest own motion that it has."""

    before: State
    particles: Particles


class ImageComparison(NamedTuple):
    """A measurement beside what the hypotheses expect of it."""

    prediction: Prediction
    measurement: Measurement  # with the noise of our attitude and of the camera's unknown delay
    pose: CameraPose
    expected: update.Expected

    @property
    def cost(self) -> float:
        """Minus twice the log-likelihood of the measurement, but for a constant.

        Of two predictions that it fits, the sharper one explains it better. That of all hypotheses: one that is
        far off changes little."""
        return -2.0 * update.log_likelihood(self.expected)


class BeliefFilter:
    """A filter of one target, of this `shape`; FilterErrors pass through.

    An image whose NIS is above the `gate` is not fused. `delay_sigma` (s): of the camera's stamps."""

    components: tuple[str, ...] = COMPONENTS
    units: tuple[str, ...] = UNITS

    def __init__(self, settings: LeaderModel, shape: Shape, delay_sigma: float) -> None:
        self.shape, self.gate = shape, settings.gate
        self._settings, self._delay_sigma = settings, delay_sigma

    def start(
        self,
        measurement: Measurement,
        pose: CameraPose,
        before: State | None,
        size: Size | None = None,
        mean_nis: float | None = None,
    ) -> State:
        """Start from an image.

        Of what was believed before, the headings are kept. `size`: as it is known by more than images; `mean_nis`:
        how far from all hypotheses the images before were, None: as it was."""
        settings = of_size = self._settings if before is None else before.settings
        if size is not None:
            of_size = settings._replace(size=size.value, size_sigma=size.sigma)
        particles = start(of_size, measurement, pose, None if before is None else before.particles)
        if mean_nis is not None:
            particles = particles._replace(mean_nis=mean_nis)
        return State(particles, summarise(of_size, particles), Pending(0.0, NOWHERE, pose.v_F_n), settings)

    def informed(self, state: State, prior: Belief, *, flew: bool) -> State | None:
        """See `update.informed`."""
        particles = update.informed(self._settings, state.particles, prior, flew=flew)
        return None if particles is None else self._at(state, particles)

    def advance(self, state: State, step: Step) -> State:
        """The hypotheses are predicted when an image comes, or after a while."""
        dt, moved, _ = state.since
        since = Pending(dt + step.dt, moved + step.dt * step.v0 + (0.5 * step.dt**2) * step.a, step.v1)
        advanced = State(state.particles, state.summary, since, state.settings)
        if since.dt <= given.MAX_PREDICTION_STEP_S:
            return advanced
        return self._at(advanced, self.predict(advanced).particles)  # no image corrects it soon

    def predict(self, state: State) -> Prediction:
        """The hypotheses predicted to now."""
        dt, moved, _ = state.since
        if dt <= 0.0:
            return Prediction(state, state.particles)
        return Prediction(state, prediction.predict(state.settings, state.particles, dt, moved))

    def compare(self, predicted: Prediction, measurement: Measurement, pose: CameraPose) -> ImageComparison:
        """A measurement, by a camera with this pose, beside what all hypotheses expect.

        Raises FilterError."""
        noise_c = pose.noise_c
        if self._delay_sigma > 0.0:
            noise_c = noise_c + self._delay_sigma**2 * (pose.omega_c[:, None] * pose.omega_c)
        measurement = measurement.with_attitude_noise(noise_c)
        expected = update.expect(predicted.particles, measurement, pose)
        return ImageComparison(predicted, measurement, pose, expected)

    def fuse(self, compared: ImageComparison) -> Update:
        """The update of all hypotheses by a measurement. Raises FilterError."""
        (state, now), measurement, pose, expected = compared
        particles, beyond = update.update(state.settings, now, measurement, pose, expected)
        beyond = max(expected.nis, beyond)
        passes = beyond <= self.gate
        after, misfits = (self._at(state, particles), particles.misfits) if passes else (state, ())
        decided = expected.nis if passes else beyond
        return Update(after, expected.innovation, expected.S, expected.y, decided, misfits, passes)

    def assist(self, state: State, taken: Auxiliary) -> State | None:
        """The state after what is measured beside the images; None where that contradicts it, or where what may be
        false would lead the size beyond MAX_SIZE_SIGMAS sigmas of the configured one. Raises FilterError."""
        now = state.summary.after(state.since.dt, state.since.moved)
        is_open = now.range_sigma() > given.MAX_RESOLVED_RANGE_SIGMA
        particles = update.assist(state.settings, self.predict(state).particles, taken, is_open=is_open)
        if particles is None:
            return None
        after, s = self._at(state, particles), self._settings
        apart = abs(float(after.summary.mean[LOG_SIZE]) - math.log(s.size)) * s.size
        return after if taken.trusted or apart < given.MAX_SIZE_SIGMAS * s.size_sigma else None

    def belief(self, state: State) -> Belief:
        """Mean and covariance of all hypotheses."""
        belief = Belief(*as_leader(state.summary.mean, state.summary.covariance, *state.since))
        late = self._delay_sigma * belief.mean[VELOCITY]
        belief.covariance[POSITION, POSITION] += late[:, None] * late
        return belief

    def published(self, state: State) -> tuple[Belief, OpenQuestion]:
        """Return mean and covariance, and what is open about them."""
        return self.belief(state), self.open_question(state)

    def open_question(self, state: State) -> OpenQuestion:
        """Whether the range is open, and then the places where the leader may be."""
        known, is_misfit = state.summary, state.particles.mean_nis > given.MEAN_NIS_LIMIT
        if not known.places:
            return OpenQuestion(is_misfit=is_misfit)
        dt, moved, v_F_n = state.since
        places = tuple(place.after(dt, moved).relative_to(v_F_n) for place in known.places)
        why = "" if state.particles.metric else "heading not resolved: "
        return OpenQuestion(f"{why}the range is uncertain", places, is_misfit)

    def is_too_wide(self, state: State, share: float) -> bool:
        """Whether the direction is less certain than `share`.

        An uncertain range is no obstacle to an image."""
        return state.summary.after(state.since.dt, state.since.moved).direction_sigma() > share

    def _at(self, state: State, particles: Particles) -> State:
        """The state now, of this particles."""
        since = Pending(0.0, NOWHERE, state.since.v_F_n)
        return State(particles, summarise(state.settings, particles), since, state.settings)


def make_filter(config: Config) -> BeliefFilter:
    """The filter of a target of this configuration."""
    return BeliefFilter(leader_model(config), shape_of(config), config.delay_sigma_s)


def leader_model(config: Config) -> LeaderModel:
    """Return the model of a leader and of our own errors."""
    known = config.own_tilt_sigma_deg, config.own_yaw_sigma_deg
    tilt, yaw = (max(given.OWN_SIGMA_FACTOR * math.radians(sigma), given.MIN_OWN_SIGMA) for sigma in known)
    model = LeaderModel(
        size=config.size_prior_m,
        size_sigma=config.size_prior_sigma_m or 0.02 * config.size_prior_m,
        misalignment=(tilt, tilt, yaw),
        misalignment_time=config.own_attitude_time_s,
        own_velocity=max(config.own_velocity_sigma_m_s, given.MIN_OWN_SIGMA),
        particles=config.particles,
    )
    if config.leader_class == "fixed_wing":
        model = model._replace(drag=0.0, drag_sigma=0.0, wind=0.0, lean_random_walk=0.0)
    return model
