"""A detector of a leader's pose, by PnP on its points or a marker, and its errors."""

import math
from typing import Final

import msgspec
import numpy as np

from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_matrix, quaternion_from_vector
from onboard.messages import DetectedPose
from simlink.sensors.arrays import Array
from simlink.sensors.camera import in_camera
from simlink.sensors.shapes import Place
from simlink.world import attitude
from simlink.world.drawn import Range

# What the corners span: a marker on the fuselage or the wing, or the points of the whole aircraft.
EXTENT: Final[Range] = (0.25, 1.0)  # wingspans: from a marker on fuselage or wing to the whole aircraft
CORNER_NOISE_PX: Final[Range] = (0.2, 0.8)  # refined corners are good to some tenths of a pixel
# A marker is printed and measured to a percent, a focal length calibrated to one.
RANGE_SCALE_SIGMA: Final[Range] = (0.01, 0.03)  # of the constant part of the range error
MARKER_MISALIGNMENT_DEG: Final[Range] = (1.0, 3.0)  # constant, about each axis
SIGMA_RATIO: Final[Range] = (0.6, 1.4)  # reported standard deviations over the true ones
# Turned out of the image plane, corners move by the cosine: an angle is some three times as noisy as the ratio.
TILT_NOISE_RATIO: Final = 3.0
MAX_TILT_NOISE: Final = math.radians(30.0)
ROLL_NOISE_RATIO: Final = 0.7  # noise in the image plane, over that of a corner over the extent
# The mirror image of a small marker fits its corners nearly as well, and for some images in a row.
FLIP_PROBABILITY: Final[Range] = (0.0, 0.25)  # of the images
MEAN_FLIP_IMAGES: Final = 10.0  # in a row
OPTICAL_FROM_C: Final = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # right, down, forward


class PoseDetector:
    """The pose detector of one encounter, its errors drawn by `rng`.

    Call `detect` once for each image, in order.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._extent, self._corner_px = rng.uniform(*EXTENT), rng.uniform(*CORNER_NOISE_PX)
        self._scale = math.exp(rng.uniform(*RANGE_SCALE_SIGMA) * rng.standard_normal())
        self._askew = np.radians(rng.uniform(*MARKER_MISALIGNMENT_DEG)) * rng.standard_normal(3)
        self._stated = rng.uniform(*SIGMA_RATIO)
        self._flips, self._is_flipped = rng.uniform(*FLIP_PROBABILITY), False

    def detect(self, place: Place) -> DetectedPose:
        """Return the leader's pose as detected in an image."""
        size, r_FL_n, q_nL, q_nF, camera, q_bc = place
        r = np.array(in_camera(r_FL_n, q_nF, camera, q_bc))
        q_nc = attitude.product(q_nF, q_bc)
        R_cL = matrix_from_quaternion(attitude.product(attitude.conjugate(q_nc), q_nL))
        range_ = float(np.linalg.norm(r))
        line = r / range_
        share = self._corner_px * range_ / (camera.f_px * self._extent * size)
        across, out, inside = (
            self._corner_px / camera.f_px * range_,
            min(TILT_NOISE_RATIO * share, MAX_TILT_NOISE),
            ROLL_NOISE_RATIO * share,
        )
        flat = np.eye(3) - np.outer(line, line)
        P = (share * range_) ** 2 * np.outer(line, line) + across**2 * flat
        turn = inside**2 * np.outer(line, line) + out**2 * flat
        seen = self._scale * r + np.linalg.cholesky(P) @ self._rng.standard_normal(3)
        R = _rotation(np.linalg.cholesky(turn) @ self._rng.standard_normal(3)) @ R_cL @ _rotation(self._askew)
        R = self._flip_if_ambiguous(R, line)
        covariance = self._stated**2 * np.block([[P, np.zeros((3, 3))], [np.zeros((3, 3)), turn]])
        both = np.kron(np.eye(2), OPTICAL_FROM_C)
        return msgspec.convert(
            {
                "position_m": (OPTICAL_FROM_C @ seen).tolist(),
                "q": quaternion_from_matrix(OPTICAL_FROM_C @ R).tolist(),
                "covariance": (both @ covariance @ both.T).tolist(),
            },
            DetectedPose,
        )

    def _flip_if_ambiguous(self, R: Array, line: Array) -> Array:
        """Return the rotation, or the one with its forward axis mirrored about the line of sight."""
        leaves = (1.0 - self._flips) if self._is_flipped else self._flips
        if self._rng.random() < leaves / MEAN_FLIP_IMAGES:
            self._is_flipped = not self._is_flipped
        normal = R[:, 0] * math.copysign(1.0, float(R[:, 0] @ line))
        axis = np.cross(normal, line)
        aslant = float(np.linalg.norm(axis))
        if not self._is_flipped or aslant < 1e-6:
            return R
        return _rotation(2.0 * math.asin(min(aslant, 1.0)) / aslant * axis) @ R


def _rotation(phi: Array) -> Array:
    return matrix_from_quaternion(quaternion_from_vector(phi))
