"""The filter that a configuration chooses, for one target.

`any-side` is what we fly by default. `wing-line` is its sharper half alone, which takes the nose to be on the
course. `belief` is to replace both: the cloud alone, with every image.
"""

import math
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.filters import modes, wing_line
from onboard.estimators.leader.filters.any_side import AnySideFilter
from onboard.estimators.leader.filters.belief import BeliefFilter
from onboard.estimators.leader.filters.filter import LeaderFilter, Measurement, Open, measure_wing
from onboard.estimators.leader.filters.modes import Modes
from onboard.estimators.leader.filters.wing_line_noise import Extras
from onboard.estimators.leader.settings import HYPOTHESES, NoseModel, settings_for
from onboard.estimators.leader.shape import Shape, shape_of
from onboard.estimators.leader.size import Size, with_size
from onboard.estimators.leader.wind import Wind
from onboard.filters.belief import Belief, Update
from onboard.models import wing_line as measurement_model
from onboard.models.leader_flight import ImageGeometry
from onboard.models.relative_motion import R
from onboard.ownship import Step

CRAB: Final = math.radians(14.0)  # rad, of a fixed wing's nose: wind of a quarter of its speed, at one sigma
UNSURE: Final = 1.4  # times the configured errors of our attitude: their sigmas are guesses, too
SMALLEST_SIGMA: Final = 1e-4  # rad; an axis of our attitude that is known better than this needs no state


def make_filter(config: Config) -> LeaderFilter:
    """The configured filter. Only the wing-line filter estimates the error of our own attitude."""
    size, size_sigma = config.size_prior_m, config.size_prior_sigma_m or 0.02 * config.size_prior_m
    tilt, yaw = np.radians([config.own_tilt_sigma_deg, config.own_yaw_sigma_deg])
    attitude_sigma = np.array([tilt, tilt, yaw])
    settings = settings_for(config.leader_class, config.process_noise)
    estimated = config.estimate_bias and bool(attitude_sigma.max() > 0)
    bias = tuple(np.maximum(attitude_sigma, SMALLEST_SIGMA).tolist()) if estimated else (0.0, 0.0, 0.0)
    extras = Extras(
        config.delay_sigma_s,
        bias,
        config.own_attitude_time_s,
        config.own_velocity_sigma_m_s,
        config.center_on_wing,
    )
    if config.filter == "belief":
        model = _nose_model(config, size, size_sigma)._replace(**HYPOTHESES)
        m = measurement_model.M_MIDDLE if config.center_on_wing else measurement_model.M
        return BeliefFilter(model, shape_of(config), config.delay_sigma_s, m)
    sharp = _WingLine(wing_line.Filter(size, size_sigma, settings, extras))
    if config.filter == "wing-line":
        return sharp
    return AnySideFilter(sharp, _nose_model(config, size, size_sigma), shape_of(config))


def _nose_model(config: Config, size: float, size_sigma: float) -> NoseModel:
    known = config.own_tilt_sigma_deg, config.own_yaw_sigma_deg
    tilt, yaw = (max(UNSURE * math.radians(sigma), SMALLEST_SIGMA) for sigma in known)
    model = NoseModel(
        size=size,
        size_sigma=size_sigma,
        misalignment=(tilt, tilt, yaw),
        misalignment_time=config.own_attitude_time_s,
        own_velocity=max(config.own_velocity_sigma_m_s, SMALLEST_SIGMA),
        particles=config.particles,
    )
    if config.leader_class == "fixed_wing":
        return model._replace(
            drag=0.0,
            drag_sigma=0.0,
            wind=0.0,
            lean_random_walk=0.0,
            crab=CRAB,
            follows=1.0,
            nose_about_course=CRAB,
        )
    return model


def is_wide(belief: Belief, share: float) -> bool:
    """Whether the position's largest standard deviation exceeds this share of the range."""
    widest = float(np.linalg.eigvalsh(belief.covariance[R, R])[-1])
    return widest > (share * float(np.linalg.norm(belief.mean[R]))) ** 2


class _WingLine:
    """`wing_line`, which has an axis of targets, for one target."""

    def __init__(self, filter_: wing_line.Filter) -> None:
        self.components, self.units = filter_.components, filter_.units
        self.measured_components: tuple[str, ...] = measurement_model.COMPONENTS[: filter_.m]
        self.measured_units: tuple[str, ...] = measurement_model.UNITS[: filter_.m]
        self.gate: float | None = filter_.gate
        self.shape: Shape | None = None
        self._filter = filter_

    def measure(self, points: Array, sigmas: Array) -> Measurement:
        return measure_wing(points, sigmas, self._filter.m)

    def start(self, measurement: Measurement, pose: CameraPose, before: Any) -> Modes:
        known = None if before is None else modes.mixture(before)
        y, R, geometry = _batch(measurement, pose)
        return wing_line.start(self._filter, y, R, geometry, known)

    def informed(self, state: Modes, prior: Belief) -> Modes | None:
        """It makes no use of it."""
        del prior
        return state

    def advance(self, state: Modes, step: Step) -> Modes:
        return wing_line.advance(self._filter, state, step.dt, step.v0[None], step.a[None])

    def fuse(self, state: Modes, measurement: Measurement, pose: CameraPose) -> Update:
        u = wing_line.fuse(self._filter, state, *_batch(measurement, pose))
        return Update(u.belief, u.innovation[0], u.innovation_covariance[0], u.predicted[0], float(u.nis[0]))

    def finish(self, state: Modes) -> None:
        del state  # nothing is postponed

    def resized(self, state: Modes, size: Size) -> Modes:
        means, covariances = with_size(state.means, state.covariances, size)
        return state._replace(means=means, covariances=covariances)

    def in_wind(self, state: Modes, wind: Wind) -> Modes:
        """`any_side` makes use of it."""
        del wind
        return state

    def belief(self, state: Modes) -> Belief:
        mean, covariance = modes.mixture(state)
        return Belief(mean[0], covariance[0])

    def open_question(self, state: Modes) -> Open:
        del state
        return Open()

    def is_too_wide(self, state: Modes, share: float) -> bool:
        return is_wide(self.belief(state), share)

    def predicted_points(self, state: Modes, measurement: Measurement, update: Update, pose: CameraPose) -> Array:
        del update
        *_, geometry = _batch(measurement, pose)
        points: Array = modes.predicted_points(state, geometry, self._filter.model.hover_speed)[0]
        return points


def _batch(measurement: Measurement, pose: CameraPose) -> tuple[Array, Array, ImageGeometry]:
    """y, R and the image's geometry with an axis of one target."""
    geometry = ImageGeometry(*(array[None] for array in (*pose[:4], measurement.axes)))
    return measurement.y[None], measurement.R[None], geometry
