"""Range and heading by a detector's pose."""

import math
from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import MARKER_HEADING_BIAS, MIN_LEVEL_HEADING, MIN_RANGE_SIGMA_RATIO
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import RelativePose


class MeasuredHeading(NamedTuple):
    """Azimuths in n, rad: of the heading, and of its mirror image about the line of sight."""

    at: float
    mirrored: float
    sigma: float


class PoseFeatures(NamedTuple):
    """Range and heading by a pose, in c."""

    range_: float | None  # m; None where the position is not known
    range_sigma: float  # m, of its noise
    range_bias: float  # of the range, one standard deviation
    line: Array  # (3,) the direction of the center
    forward: Array | None  # (3,) the aircraft's axis; None where the rotation is not known
    turn: Array  # (3, 3) rad^2, covariance of the rotation

    def heading(self, camera: CameraPose) -> MeasuredHeading | None:
        """Return the heading; None if it is not known."""
        if self.forward is None:
            return None
        fx, fy, fz = (self.forward @ camera.R_cn).tolist()
        level2 = fx * fx + fy * fy
        if level2 < MIN_LEVEL_HEADING**2:
            return None
        # by how much a small rotation about n's axes turns the azimuth
        by = camera.R_cn @ np.array([-fz * fx / level2, -fz * fy / level2, 1.0])
        sigma = math.sqrt(float(by @ self.turn @ by) + MARKER_HEADING_BIAS**2)
        line = self.line @ camera.R_cn
        at, sight = math.atan2(fy, fx), math.atan2(line[1], line[0])
        return MeasuredHeading(at, 2.0 * sight - at, sigma)


def measured_pose(pose: RelativePose, range_bias: float, line: Array) -> PoseFeatures:
    """Measure range and heading by a pose.

    `range_bias`: a share of the range, one standard deviation; `line` (3,): the direction of the center in c,
    where the pose has none."""
    range_, sigma = None, math.inf
    if pose.r_CL_c is not None and pose.r_covariance is not None:
        r = np.array(pose.r_CL_c)
        range_ = float(np.linalg.norm(r))
        line = r / range_
        sigma = max(math.sqrt(float(line @ np.array(pose.r_covariance) @ line)), MIN_RANGE_SIGMA_RATIO * range_)
    forward, turn = None, np.zeros((3, 3))
    if pose.q_cL is not None and pose.turn_covariance is not None:
        forward, turn = matrix_from_quaternion(pose.q_cL)[:, 0], np.array(pose.turn_covariance)
    return PoseFeatures(range_, sigma, range_bias, line, forward, turn)
