"""Rotations: unit quaternions (Hamilton, scalar first), matrices, ZYX Euler angles.

All angles are in radians.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array


def wrap_angle(angle: ArrayLike) -> Array:
    """Wrap angles to [-pi, pi)."""
    return (np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi


def matrix_from_quaternion(q_nb: ArrayLike) -> Array:
    """Return R_nb (..., 3, 3) of q_nb (..., 4), which need not be of unit length."""
    q = np.asarray(q_nb, dtype=float)
    if q.ndim == 1:
        return matrix_of(q.tolist())
    return np.moveaxis(np.array(_rows(*np.moveaxis(q, -1, 0))), (0, 1), (-2, -1))


def matrix_of(q_nb: Sequence[float]) -> Array:
    """Return R_nb (3, 3) of one quaternion of plain numbers, which is many times faster."""
    return np.array(_rows(*q_nb))


def _rows(w: Any, x: Any, y: Any, z: Any) -> list[list[Any]]:
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return [
        [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
    ]


def quaternion_from_matrix(R_nb: ArrayLike) -> Array:
    """Return q_nb (4,) with non-negative scalar part of R_nb (3, 3).

    By Shepperd's method (largest pivot).
    """
    # in plain numbers, which are many times faster
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(R_nb, dtype=float).tolist()
    diagonal = [a + e + i, a - e - i, e - a - i, i - a - e]
    pivot = diagonal.index(max(diagonal))
    if pivot == 0:
        row = [diagonal[0] + 1.0, h - f, c - g, d - b]
    elif pivot == 1:
        row = [h - f, diagonal[1] + 1.0, b + d, c + g]
    elif pivot == 2:
        row = [c - g, b + d, diagonal[2] + 1.0, f + h]
    else:
        row = [d - b, c + g, f + h, diagonal[3] + 1.0]
    q = np.array(row)
    q /= math.sqrt(q @ q)
    return -q if q[0] < 0 else q


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Array:
    """Return q_nb (4,) of the ZYX sequence: yaw about down, then pitch, then roll."""
    cr, sr = np.cos(roll / 2), np.sin(roll / 2)
    cp, sp = np.cos(pitch / 2), np.sin(pitch / 2)
    cy, sy = np.cos(yaw / 2), np.sin(yaw / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def euler_from_quaternion(q_nb: ArrayLike) -> tuple[float, float, float]:
    """Return (roll, pitch, yaw) of q_nb; pitch in [-pi/2, pi/2]."""
    m = matrix_from_quaternion(q_nb)
    roll = float(np.arctan2(m[2, 1], m[2, 2]))
    pitch = float(np.arcsin(np.clip(-m[2, 0], -1.0, 1.0)))
    yaw = float(np.arctan2(m[1, 0], m[0, 0]))
    return roll, pitch, yaw


def matrix_from_euler(roll: float, pitch: float, yaw: float) -> Array:
    """Return R_nb (3, 3) of the ZYX sequence."""
    return matrix_from_quaternion(quaternion_from_euler(roll, pitch, yaw))


def quaternion_product(p: ArrayLike, q: ArrayLike) -> Array:
    """Return the Hamilton product (4,): q_ac = quaternion_product(q_ab, q_bc)."""
    pw, px, py, pz = np.asarray(p, dtype=float)
    qw, qx, qy, qz = np.asarray(q, dtype=float)
    return np.array(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ]
    )


def quaternion_from_vector(phi: ArrayLike) -> Array:
    """Return the quaternion (4,) of a rotation by |phi| radians about phi (3,)."""
    phi = np.asarray(phi, dtype=float)
    angle = float(np.linalg.norm(phi))
    # sin(x/2)/x tends to 1/2: exact to double precision below 1e-8
    scale = 0.5 if angle < 1e-8 else np.sin(angle / 2) / angle
    return np.concatenate([[np.cos(angle / 2)], scale * phi])


def vector_from_quaternion(q: ArrayLike) -> Array:
    """Return the rotation vector (3,), rad, of a unit quaternion (4,).

    Its length is at most pi.
    """
    w, *vector = np.asarray(q, dtype=float) * (-1.0 if np.asarray(q)[0] < 0 else 1.0)
    sine = float(np.linalg.norm(vector))
    # angle / sin(angle / 2) tends to 2: exact to double precision below 1e-8
    scale = 2.0 if sine < 1e-8 else 2.0 * np.arctan2(sine, w) / sine
    return np.asarray(scale * np.array(vector))


def slerp(q0: ArrayLike, q1: ArrayLike, fraction: float) -> Array:
    """Return the quaternion (4,) at a `fraction` of the shorter great circle from q0 to q1."""
    a, b = np.asarray(q0, dtype=float), np.asarray(q1, dtype=float)
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    # below 1e-6 rad apart the great circle is a straight line to double precision
    if cosine > 1 - 1e-12:
        q = a + fraction * (b - a)
        return np.asarray(q / np.linalg.norm(q))
    angle = np.arccos(min(cosine, 1.0))
    return np.asarray((np.sin((1 - fraction) * angle) * a + np.sin(fraction * angle) * b) / np.sin(angle))
