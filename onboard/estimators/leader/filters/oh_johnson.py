"""Oh & Johnson's filter of a leader: nine states and three angles, by one unscented filter."""

from functools import partial
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters import oh_johnson_noise
from onboard.estimators.leader.filters.filter import Measurement, Open
from onboard.estimators.leader.settings import Noise
from onboard.estimators.leader.shape import Shape
from onboard.estimators.leader.size import Size, with_size
from onboard.estimators.leader.wind import Wind
from onboard.filters import unscented
from onboard.filters.belief import Belief, Update
from onboard.filters.gating import chi_square_threshold
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import FollowerMotion
from onboard.ownship import Step

WEIGHTS: Final = unscented.julier_weights(relative_motion.N)


class OhJohnson:
    """The paper's filter, with a prior `size` and its sigma in m.

    `attitude_sigma` (3,) rad about n is the error of our own attitude. It is nearly constant, so images cannot
    average it out and innovations do not show it: it is added to the covariance that is reported, and to nothing
    else.
    """

    def __init__(self, noise: Noise, size: float, size_sigma: float, attitude_sigma: Array) -> None:
        self.components: tuple[str, ...] = relative_motion.COMPONENTS
        self.units: tuple[str, ...] = relative_motion.UNITS
        self.measured_components: tuple[str, ...] = camera_angles.COMPONENTS
        self.measured_units: tuple[str, ...] = camera_angles.UNITS
        probability = noise.gate_probability
        self.gate: float | None = (
            None if probability is None else chi_square_threshold(probability, camera_angles.M)
        )
        self.images: int | None = noise.initialise_images
        self.shape: Shape | None = None
        self._noise, self._size, self._size_sigma = noise, size, size_sigma
        self._attitude_sigma = attitude_sigma
        self._Q = oh_johnson_noise.process_noise(noise, size)
        self._considered = (relative_motion.SIZE,) if noise.consider_size else ()

    def measure(self, points: Array, sigmas: Array) -> Measurement:
        """Azimuth, elevation and span of image points (3, 2) with standard deviations (3,)."""
        angles = camera_angles.angles_from_points(points)
        R = camera_angles.noise_from_points(points, sigmas)
        sigma = float(np.sqrt(R[2, 2]))
        if self._noise.angles_deg is not None:
            R = np.diag(np.radians(self._noise.angles_deg) ** 2)
        center, wing = np.array([1.0, *points[0]]), points[2] - points[1]
        length = np.hypot(*wing)
        axes = np.zeros((3, 3))
        axes[0], axes[1, 1:] = center / np.linalg.norm(center), wing / length if length else wing
        return Measurement(angles, R, float(angles[2]), sigma, axes)

    def start(self, measurement: Measurement, pose: CameraPose, before: Any) -> Belief:
        """The belief after a first image: eqs 43-51."""
        del before  # the paper starts anew
        return oh_johnson_noise.initial_belief(
            self._noise, measurement.y, measurement.R, self._size, self._size_sigma, pose.R_cn, pose.r_FC_n
        )

    def advance(self, state: Belief, step: Step) -> Belief:
        """The belief after a step of our own motion: eqs 5-10."""
        motion = FollowerMotion(step.v0, step.v1, step.a, step.a)
        process = partial(relative_motion.process, dt=step.dt, follower=motion, eps=self._noise.hover_speed)
        return unscented.predict(state, process, np.diag(self._Q * step.dt), WEIGHTS)

    def fuse(self, state: Belief, measurement: Measurement, pose: CameraPose) -> Update:
        """The update by an image: eqs 11-17."""
        measure = partial(camera_angles.measure, R_cn=pose.R_cn, r_FC_n=pose.r_FC_n)
        y, R = measurement.y, measurement.R
        return unscented.update(state, y, measure, R, WEIGHTS, camera_angles.ANGULAR, self._considered)

    def finish(self, state: Belief) -> None:
        """Nothing is postponed."""

    def resized(self, state: Belief, size: Size) -> Belief:
        """The belief with another marginal of the size."""
        return Belief(*with_size(state.mean, state.covariance, size))

    def in_wind(self, state: Belief, wind: Wind) -> Belief:
        """The paper knows no wind."""
        del wind
        return state

    def belief(self, state: Belief) -> Belief:
        """Mean (9,) and covariance (9, 9), with the error of our own attitude added."""
        own = relative_motion.rotation_covariance(state.mean, self._attitude_sigma)
        return Belief(state.mean, state.covariance + own)

    def predicted_points(self, state: Belief, measurement: Measurement, update: Update, pose: CameraPose) -> Array:
        """The center at the predicted angles, the wingtips at the predicted span along the measured wing: this
        filter does not predict the leader's bank."""
        del state, pose
        center = np.tan(update.predicted[:2])
        half = np.tan(0.5 * update.predicted[2]) * np.sqrt(1.0 + center @ center)
        wing = measurement.axes[1, 1:]
        return np.array([center, center - half * wing, center + half * wing])

    def open_question(self, state: Belief) -> Open:
        """Nothing: this filter knows of no other answer."""
        del state
        return Open()

    def is_too_wide(self, state: Belief, share: float) -> bool:
        """Whether the position's largest standard deviation exceeds this share of the range."""
        widest = float(np.linalg.eigvalsh(state.covariance[relative_motion.R, relative_motion.R])[-1])
        return widest > (share * float(np.linalg.norm(state.mean[relative_motion.R]))) ** 2
