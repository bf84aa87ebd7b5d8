"""The model of another aircraft: parameters and random beliefs."""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler
from onboard.models.intruder import motion
from onboard.models.intruder.attitude_error import AttitudeErrorModel, with_attitude_error
from onboard.models.intruder.motion import MotionModel

R_RN: Final = matrix_from_euler(0.1, -0.2, 2.0).T
RADAR: Final = np.array([100.0, -50.0, -30.0])
MODEL: Final = MotionModel(
    acceleration=np.array([2.5, 2.5, 1.2]),
    acceleration_time=8.0,
    keeps_turn=False,
    gust=np.array([0.3, 0.3, 0.15]),
    drift=0.2,
    bias_time=60.0,
)
ATTITUDE_ERROR: Final = AttitudeErrorModel(np.diag([0.01, 0.01, 0.02]), np.ones(3), np.full(3, 10.0))


def complete_step(dt: float, model: MotionModel) -> motion.MotionStep:
    return with_attitude_error(motion.step(dt, model), ATTITUDE_ERROR)


def beliefs(count: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    mean = np.concatenate([rng.uniform(-2000, 2000, (count, 3)), rng.normal(0, 20, (count, 12))], axis=1)
    mean[:, 9:] *= np.repeat([0.1, 0.001], 3)
    root = rng.normal(0, 1, (count, 15, 15)) * np.repeat([5.0, 1.0, 0.5, 1.0, 0.01], 3)[:, None]
    return mean, root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(15)
