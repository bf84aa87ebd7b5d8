"""Interpolation and extrapolation of attitudes in plain numbers, faster than arrays.

`onboard.geometry.rotations` has the same functions for arrays; a test compares both.
"""

import math
from typing import Final

from onboard.messages import Quaternion, Vec3

SLERP_TOLERANCE: Final = 1e-12  # 1 - cosine; below, linear interpolation is exact to double precision.
SMALL_ANGLE: Final = 1e-8  # rad; below, sin(x/2)/x is 1/2 to double precision.


def turned(q: Quaternion, omega: Vec3, dt: float) -> Quaternion:
    """Return q_nb after `dt` seconds of constant rates omega_b, rad/s."""
    w, x, y, z = q
    a, b, c = omega
    rate = math.sqrt(a * a + b * b + c * c)
    half = 0.5 * rate * dt
    scale = 0.5 * dt if abs(half) < SMALL_ANGLE else math.sin(half) / rate
    s, a, b, c = math.cos(half), scale * a, scale * b, scale * c
    return (
        w * s - x * a - y * b - z * c,
        w * a + x * s + y * c - z * b,
        w * b - x * c + y * s + z * a,
        w * c + x * b - y * a + z * s,
    )


def between(q0: Quaternion, q1: Quaternion, fraction: float) -> Quaternion:
    """Interpolate from q0 to q1 along the shorter great circle."""
    cosine = q0[0] * q1[0] + q0[1] * q1[1] + q0[2] * q1[2] + q0[3] * q1[3]
    sign = -1.0 if cosine < 0.0 else 1.0
    cosine = min(abs(cosine), 1.0)
    if cosine > 1.0 - SLERP_TOLERANCE:
        first, second = 1.0 - fraction, fraction
    else:
        angle = math.acos(cosine)
        first, second = math.sin((1.0 - fraction) * angle), math.sin(fraction * angle)
    second *= sign
    a, b = first, second
    (w, x, y, z), (w1, x1, y1, z1) = q0, q1
    return unit((a * w + b * w1, a * x + b * x1, a * y + b * y1, a * z + b * z1))


def unit(q: Quaternion) -> Quaternion:
    """Normalise a quaternion."""
    w, x, y, z = q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length
