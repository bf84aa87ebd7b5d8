"""Target that turns at a constant rate and speed in a plane: the coordinated turn.

State rows [x, y, vx, vy, rate], m, m/s and rad/s, in any frame whose third axis is normal to the plane; the rate
is positive from x to y. The solution is exact, and has no singularity at a rate of zero. Bar-Shalom, Li &
Kirubarajan 2001, section 11.7.
"""

from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import white_acceleration

STATE_SIZE: Final = 5


def process(rows: Array, dt: float) -> Array:
    """Return state rows (k, 5) after `dt` seconds; the rows may be integers or complex."""
    x, y, vx, vy, rate = rows.T
    half = (0.5 * dt) * rate
    chord = dt * np.sinc(half / np.pi)  # of the circle, over the speed
    sine, cosine = np.sin(half), np.cos(half)
    return np.stack(
        [
            x + chord * (cosine * vx - sine * vy),
            y + chord * (sine * vx + cosine * vy),
            np.cos(2 * half) * vx - np.sin(2 * half) * vy,
            np.sin(2 * half) * vx + np.cos(2 * half) * vy,
            rate,
        ],
        axis=1,
    )


def noise(dt: float, q_acceleration: float, q_rate: float) -> Array:
    """Return the process noise (5, 5) of a step of `dt` seconds.

    Parameters
    ----------
    q_acceleration
        Density of the white acceleration on each axis, (m/s^2)^2/Hz.
    q_rate
        Density of the random walk of the rate, (rad/s)^2/s.

    Raises
    ------
    FilterError
        If an argument is not a finite number that is at least zero.
    """
    Q: Any = np.zeros((STATE_SIZE, STATE_SIZE))
    Q[:4, :4] = white_acceleration(dt, q_acceleration, axes=2).Q
    Q[4, 4] = q_rate * dt
    return np.asarray(Q)
