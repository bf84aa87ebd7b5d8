"""A leader carried on beyond what was seen of it: it flies on at its speed and in its turn."""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array

SLOW: Final = 1.0  # m/s: a slower leader has no course to turn from
FASTEST_TURN: Final = 0.5  # rad/s: an acceleration beyond is no turn that lasts


def turn_rate(v: Array, a: Array) -> float:
    """The rate at which a velocity turns, rad/s, positive to the right; v, a (3,) in n. 0 where it is slow."""
    square = float(v[0] * v[0] + v[1] * v[1])
    if square < SLOW * SLOW:
        return 0.0
    return min(max(float(v[0] * a[1] - v[1] * a[0]) / square, -FASTEST_TURN), FASTEST_TURN)


def carried(r: Array, v: Array, rate: float, dt: float) -> tuple[Array, Array]:
    """Position and velocity (3,), n, `dt` s later: on a circle at `rate`, rad/s, and straight on in height."""
    moved, rotated = turning(rate, dt)
    return r + moved @ v, rotated @ v


def turning(rate: float, dt: float) -> tuple[Array, Array]:
    """What takes a velocity to the way flown and to the velocity after it, (3, 3) each."""
    half = 0.5 * rate * dt
    chord = dt * float(np.sinc(half / math.pi))
    along, across = chord * math.cos(half), chord * math.sin(half)
    c, s = math.cos(2.0 * half), math.sin(2.0 * half)
    moved = np.array([[along, -across, 0.0], [across, along, 0.0], [0.0, 0.0, dt]])
    return moved, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
