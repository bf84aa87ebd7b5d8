"""Prediction of a leader at constant speed and turn rate."""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.geometry.path_axes import MIN_COURSE_SPEED_M_S

MAX_TURN_RATE_RAD_S: Final = 0.5  # No aircraft keeps a faster turn.


def turn_rate(v: Array, a: Array) -> float:
    """Return the turn rate of a velocity, rad/s, positive right; 0 at low speed.

    Velocity v and acceleration a are (3,) in n.
    """
    square = float(v[0] * v[0] + v[1] * v[1])
    if square < MIN_COURSE_SPEED_M_S * MIN_COURSE_SPEED_M_S:
        return 0.0
    return min(max(float(v[0] * a[1] - v[1] * a[0]) / square, -MAX_TURN_RATE_RAD_S), MAX_TURN_RATE_RAD_S)


def carried(r: Array, v: Array, rate: float, dt: float) -> tuple[Array, Array]:
    """Return position and velocity (3,) in n after `dt` s of a level circle at `rate`, rad/s."""
    moved, rotated = turning(rate, dt)
    return r + moved @ v, rotated @ v


def turning(rate: float, dt: float) -> tuple[Array, Array]:
    """Return matrices (3, 3) from a velocity to displacement and velocity after `dt` s."""
    half = 0.5 * rate * dt
    chord = dt * float(np.sinc(half / math.pi))
    along, across = chord * math.cos(half), chord * math.sin(half)
    c, s = math.cos(2.0 * half), math.sin(2.0 * half)
    moved = np.array([[along, -across, 0.0], [across, along, 0.0], [0.0, 0.0, dt]])
    return moved, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
