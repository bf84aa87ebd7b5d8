"""Three angles of a leader in an image, from three image points. Oh & Johnson, II.B-C, eqs 11-18, 43-50.

Measurement: [gamma_y azimuth (positive right), gamma_z elevation (positive BELOW the axis), alpha subtended].

Erratum: eq 14 prints x_3 in its third row where the size x_7 must stand. Eq 17 assumes a wing parallel to the
image plane; a leader yawed by 30 / 45 / 60 degrees appears to be 15 / 41 / 100 % more distant than it is.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import CUBE, MAKING, OUT, ROWS, VECTOR, kernel
from onboard.geometry.arctangent import arctan2
from onboard.models import relative_motion
from onboard.models.relative_motion import BLOCK_ROWS

MEASUREMENT_SIZE: Final = 3
COMPONENTS: Final = ("azimuth", "elevation", "subtended")
UNITS: Final = ("rad", "rad", "rad")
ANGULAR: Final = (0, 1, 2)  # all wrap


def measure(points: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """Return angles (k, 3), rad, of state rows (k, 9), seen by a camera: eq 14.

    R_cn (3, 3) is the camera's attitude, and r_FC_n (3,) its position, m. atan2 replaces atan, which folds over
    behind the camera.
    """
    angles = np.empty((len(points), MEASUREMENT_SIZE))  # faster than an array from machine code
    _measure(points, R_cn, r_FC_n, angles)
    return angles


@kernel(**MAKING)
def _angles(places, angles, count):
    """Write the three angles of `count` rows into `angles` (3 BLOCK_ROWS,).

    `places` (4 BLOCK_ROWS,) holds x, y, z in c and the size, each in a block of its own.
    """
    for s in range(count):
        x, y, z = places[s], places[BLOCK_ROWS + s], places[2 * BLOCK_ROWS + s]
        angles[s] = arctan2(y, x)
        angles[BLOCK_ROWS + s] = arctan2(z, x)
        angles[2 * BLOCK_ROWS + s] = 2.0 * arctan2(
            places[3 * BLOCK_ROWS + s], 2.0 * np.sqrt(x * x + y * y + z * z)
        )


@kernel((ROWS, ROWS, VECTOR, OUT), **MAKING)
def _measure(points, R_cn, r_FC_n, angles):
    """Process blocks of rows, so that roots and arctangents of several rows become one instruction."""
    places, block = np.empty(4 * BLOCK_ROWS), np.empty(3 * BLOCK_ROWS)
    for first in range(0, points.shape[0], BLOCK_ROWS):
        count = min(BLOCK_ROWS, points.shape[0] - first)
        for s in range(count):
            row = points[first + s]
            north, east, down = row[0] - r_FC_n[0], row[1] - r_FC_n[1], row[2] - r_FC_n[2]
            for i in range(3):
                places[i * BLOCK_ROWS + s] = R_cn[i, 0] * north + R_cn[i, 1] * east + R_cn[i, 2] * down
            places[3 * BLOCK_ROWS + s] = row[relative_motion.SIZE]
        _angles(places, block, count)
        for s in range(count):
            for i in range(3):
                angles[first + s, i] = block[i * BLOCK_ROWS + s]


def measure_batch(points: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """`measure` for B filters: points (B, k, 9), and a camera for each, (B, 3, 3) and (B, 3)."""
    angles: Array = _measure_batch(points, R_cn, r_FC_n)
    return angles


@kernel((CUBE, CUBE, ROWS), **MAKING)
def _measure_batch(points, R_cn, r_FC_n):
    angles = np.empty((points.shape[0], points.shape[1], 3))
    for b in range(points.shape[0]):
        _measure(points[b], R_cn[b], r_FC_n[b], angles[b])
    return angles


def angles_from_points(points: Array) -> Array:
    """Return angles (..., 3), rad, of image points (..., 3, 2) in focal lengths: eq 18.

    The points are center, left and right.
    """
    center, wing = points[..., 0, :], points[..., 1, :] - points[..., 2, :]
    span = np.hypot(wing[..., 0], wing[..., 1])
    D = np.sqrt(1.0 + center[..., 0] ** 2 + center[..., 1] ** 2)
    angles = np.empty((*center.shape[:-1], 3))
    angles[..., :2] = np.arctan(center)
    angles[..., 2] = 2.0 * np.arctan2(span, 2.0 * D)
    return angles


def noise_from_points(points: Array, sigmas: Array) -> Array:
    """Return R (..., 3, 3), rad^2, of the angles of image points (..., 3, 2), by the Jacobian of eq 18.

    `sigmas` (3,) are the standard deviations of each coordinate of the center, left and right point. The center's
    weak influence on alpha is neglected.
    """
    center, wing = points[..., 0, :], points[..., 1, :] - points[..., 2, :]
    span = np.hypot(wing[..., 0], wing[..., 1])
    D = np.sqrt(1.0 + center[..., 0] ** 2 + center[..., 1] ** 2)
    d_alpha = (1.0 / D) / (1.0 + (span / (2.0 * D)) ** 2)
    R = np.zeros((*center.shape[:-1], 3, 3))
    R[..., 0, 0] = (sigmas[0] / (1.0 + center[..., 0] ** 2)) ** 2
    R[..., 1, 1] = (sigmas[0] / (1.0 + center[..., 1] ** 2)) ** 2
    R[..., 2, 2] = (sigmas[1] ** 2 + sigmas[2] ** 2) * d_alpha**2
    return R


def position_from_angles(angles: Array, size: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """Return r_FL_n (k, 3), m, of angles (k, 3), rad, and sizes (k,), m: eqs 43 and 48-50."""
    tan_y, tan_z = np.tan(angles[:, 0]), np.tan(angles[:, 1])
    x = size / (2.0 * np.tan(0.5 * angles[:, 2]) * np.sqrt(1.0 + tan_y**2 + tan_z**2))
    return np.column_stack([x, x * tan_y, x * tan_z]) @ R_cn + r_FC_n
