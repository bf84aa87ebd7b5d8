"""Measurements of another aircraft's state: echoes at a radar on our vehicle, and its own reports.

State rows as in `onboard.models.intruder.motion`. A measurement may be older than the state, by `lag` seconds. The
state is then moved back at constant acceleration: process noise within a second is small against the noise of any
reported position.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import CUBE, FLOAT, MAKING, ROWS, VECTOR, ArrayKind, kernel
from onboard.geometry.arctangent import arctan2
from onboard.models.intruder.motion import ACCELERATION, BIAS, POSITION, VELOCITY, earlier_position

ECHO_SIZE: Final = 3  # components
REPORT_SIZE: Final = 6  # components
POLAR: Final = ("range", "azimuth", "elevation")
POLAR_UNITS: Final = ("m", "rad", "rad")
POLAR_ANGULAR: Final = (1, 2)
BLOCK_ROWS: Final = 64  # Rows per block of the compiled loops.


def report(rows: Array, lag: Array, bias_sigma: Array) -> Array:
    """Return the position and velocity (k, 6) that the aircraft reported `lag` (k,) seconds before.

    `bias_sigma` (k, 3), m, is the unit of the state `bias`.
    """
    reported = np.empty((len(rows), REPORT_SIZE))
    reported[:, POSITION] = earlier_position(rows, lag) + bias_sigma * rows[:, BIAS]
    reported[:, VELOCITY] = rows[:, VELOCITY] - lag[:, None] * rows[:, ACCELERATION]
    return reported


def echo(rows: Array, lag: Array, r_OR_n: Array, R_rn: Array) -> Array:
    """Return range (m), azimuth (positive right) and elevation (positive up, rad), (k, 3).

    The echoes are `lag` (k,) seconds old. The radar is at r_OR_n (3,) with attitude R_rn (3, 3).
    """
    polar: Array = _echo(rows, lag, r_OR_n, R_rn)
    return polar


def expected_echo(means: Array, covariances: Array, lag: float, r_OR_n: Array, R_rn: Array) -> tuple[Array, Array]:
    """Return `echo` (k, 3) of beliefs (k, 15) and (k, 15, 15), and its covariance (k, 3, 3), to first order.

    The covariance does not contain the radar's own noise.
    """
    outputs: tuple[Array, Array] = _expected_echo(means, covariances, lag, r_OR_n, R_rn)
    return outputs


def position(polar: Array, r_OR_n: Array, R_rn: Array) -> Array:
    """Return r_OT_n (k, 3) of echoes (k, 3)."""
    r, azimuth, elevation = polar[:, 0], polar[:, 1], polar[:, 2]
    level = r * np.cos(elevation)
    cartesian = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -r * np.sin(elevation)], axis=-1)
    return np.asarray(cartesian @ R_rn + r_OR_n)


def position_noise(polar: Array, sigma: Array, R_rn: Array) -> Array:
    """Return the covariance (k, 3, 3) in n of `position`, of echoes (k, 3) with standard deviations (k, 3)."""
    r, azimuth, elevation = polar[:, 0], polar[:, 1], polar[:, 2]
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    slope = np.stack(
        [
            np.stack([ce * ca, -r * ce * sa, -r * se * ca], axis=-1),
            np.stack([ce * sa, r * ce * ca, -r * se * sa], axis=-1),
            np.stack([-se, np.zeros_like(r), -r * ce], axis=-1),
        ],
        axis=-2,
    )
    root = (R_rn.T @ slope) * sigma[:, None, :]
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def cross_matrix(d: Array) -> Array:
    """Return [d x], (3, 3): cross_matrix(d) @ w is d x w."""
    return np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])


@kernel(**MAKING)
def _angles(positions, angles, count):
    """Write azimuths, then elevations, into `angles` (2 BLOCK_ROWS,).

    `positions` holds all x, then all y, then all z of `count` positions in the radar's frame.
    """
    for s in range(count):
        x, y, z = positions[s], positions[BLOCK_ROWS + s], positions[2 * BLOCK_ROWS + s]
        angles[s] = arctan2(y, x)
        angles[BLOCK_ROWS + s] = arctan2(-z, np.sqrt(x * x + y * y))


@kernel((ROWS, VECTOR, VECTOR, ROWS), **MAKING)
def _echo(rows, lag, r_OR_n, R_rn):
    """Process blocks of rows, so that arctangents of several rows become one instruction."""
    polar = np.empty((rows.shape[0], 3))
    positions, angles = np.empty(3 * BLOCK_ROWS), np.empty(2 * BLOCK_ROWS)
    d, rotated = np.empty(3), np.empty(3)
    for first in range(0, rows.shape[0], BLOCK_ROWS):
        count = min(BLOCK_ROWS, rows.shape[0] - first)
        for s in range(count):
            row, back = rows[first + s], lag[first + s]
            for i in range(3):
                d[i] = row[i] - back * (row[3 + i] - 0.5 * back * row[6 + i]) - r_OR_n[i]
            rotated[0] = d[0] + row[13] * d[2] - row[14] * d[1]
            rotated[1] = d[1] + row[14] * d[0] - row[12] * d[2]
            rotated[2] = d[2] + row[12] * d[1] - row[13] * d[0]
            for i in range(3):
                positions[i * BLOCK_ROWS + s] = (
                    R_rn[i, 0] * rotated[0] + R_rn[i, 1] * rotated[1] + R_rn[i, 2] * rotated[2]
                )
            polar[first + s, 0] = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        _angles(positions, angles, count)
        for s in range(count):
            polar[first + s, 1], polar[first + s, 2] = angles[s], angles[BLOCK_ROWS + s]
    return polar


@kernel((ArrayKind(FLOAT, 1, "m"),) * 3, **MAKING)
def _add_cross(a, b, out):
    """Add a x b to `out`."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] += a[j] * b[k] - a[k] * b[j]


@kernel((ROWS, CUBE, FLOAT, VECTOR, ROWS), **MAKING)
def _expected_echo(means, covariances, lag, r_OR_n, R_rn):
    count = means.shape[0]
    polar, spread = np.empty((count, 3)), np.empty((count, 3, 3))
    J = np.zeros((6, 15))  # Jacobian of the position `lag` before, and of the attitude error
    for i in range(3):
        J[i, i], J[i, 3 + i], J[i, 6 + i], J[3 + i, 12 + i] = 1.0, -lag, 0.5 * lag * lag, 1.0
    back = J[:3].copy()
    G, H = np.zeros((3, 3)), np.empty((3, 6))
    for s in range(count):
        mean, P = means[s].copy(), covariances[s].copy()
        rotation = mean[12:]
        d = back @ mean - r_OR_n
        rotated = d.copy()
        _add_cross(rotation, d, rotated)
        x, y, z = np.sum(R_rn[0] * rotated), np.sum(R_rn[1] * rotated), np.sum(R_rn[2] * rotated)
        level2 = max(x * x + y * y, 1.0)  # keeps the slopes finite straight above, where azimuth is undefined
        level, r2 = np.sqrt(level2), max(x * x + y * y + z * z, 1.0)
        polar[s, 0] = max(np.sqrt(np.sum(d * d)), 1.0)
        polar[s, 1], polar[s, 2] = np.arctan2(y, x), np.arctan2(-z, level)
        # Slopes by the rotated position. A rotation w moves it by w x d, and leaves the range.
        G[1] = (x * R_rn[1] - y * R_rn[0]) / level2
        G[2] = (z * (x * R_rn[0] + y * R_rn[1]) / level - level * R_rn[2]) / r2
        H[:, :3], H[:, 3:] = G, 0.0
        for m in range(1, 3):
            _add_cross(G[m], rotation, H[m, :3])
            _add_cross(d, G[m], H[m, 3:])
        H[0, :3] = d / polar[s, 0]
        slope = H @ J
        spread[s] = slope @ P @ slope.T.copy()
    return polar, spread
