"""A target that turns at a constant rate and speed in a plane: the coordinated turn (Bar-Shalom, Li & Kirubarajan
2001, section 11.7), with the rate among its states.

State rows [x, y, vx, vy, rate], m, m/s and rad/s, in any frame whose third axis is normal to the plane; the rate
is positive from x to y. It is exact, and without a singularity where the rate is zero.
"""

from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import white_acceleration

N: Final = 5
COMPONENTS: Final = ("x", "y", "vx", "vy", "rate")
UNITS: Final = ("m", "m", "m/s", "m/s", "rad/s")


def process(rows: Array, dt: float) -> Array:
    """State rows (k, 5) after `dt` seconds, in the precision of the rows; they may be integers or complex."""
    x, y, vx, vy, rate = rows.T
    half = (0.5 * dt) * rate
    chord = dt * np.sinc(half / np.pi)  # of the circle, over the speed
    sine, cosine = np.sin(half), np.cos(half)
    turned = np.stack(
        [
            x + chord * (cosine * vx - sine * vy),
            y + chord * (sine * vx + cosine * vy),
            np.cos(2 * half) * vx - np.sin(2 * half) * vy,
            np.sin(2 * half) * vx + np.cos(2 * half) * vy,
            rate,
        ],
        axis=1,
    )
    return turned.astype(rows.dtype, copy=False) if rows.dtype.kind == "f" else turned


def noise(dt: float, q_acceleration: float, q_rate: float) -> Array:
    """Process noise (5, 5) of a step of `dt` seconds: white acceleration of density `q_acceleration`,
    (m/s^2)^2/Hz, on each axis, and a random walk of the rate, (rad/s)^2/s.

    Raises FilterError.
    """
    Q: Any = np.zeros((N, N))
    Q[:4, :4] = white_acceleration(dt, q_acceleration, axes=2).Q
    Q[4, 4] = q_rate * dt
    return np.asarray(Q)
