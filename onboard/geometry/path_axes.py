"""The axes of a path, in which accelerations are given: Oh & Johnson, section II.A, eq 2, and along the track.

With a velocity (u, v, w) in n, h its horizontal and V its whole speed, the rows of the matrix are unit vectors:

    right  (-v, u, 0) / h              a_lat:   level, positive in a right turn
    up     (u w, v w, -h^2) / (h V)    a_long:  normal to the velocity, in its vertical plane, positive up
    along  (u, v, w) / V               a_along: on the track

The three are orthogonal: the accelerations are the matrix times a_n, and a_n is its transpose times them. A
vehicle that is slower than SLOW over ground has no course: its axes are level, and along its heading.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from onboard.arrays import Array

SLOW: Final = 1.0  # m/s, over ground


def path_angles(u: float, v: float, w: float, heading: float) -> tuple[float, float, float, float]:
    """Cosine and sine of the course and of the climb angle of a velocity (m/s, in n). `heading` (rad): instead of
    the course of a slow one, which then does not climb. Kernels may compile it into their own machine code."""
    h2 = u * u + v * v
    if h2 <= SLOW * SLOW:
        return np.cos(heading), np.sin(heading), 1.0, 0.0
    h, whole = np.sqrt(h2), np.sqrt(h2 + w * w)
    return u / h, v / h, h / whole, -w / whole


def acceleration_of(values: Mapping[str, float], v_n: Array) -> Array:
    """a_n (3,) of a vehicle with the velocity v_n (3,), by its a_lat, a_long and a_along, as far as `values` has
    them; of a slow one along its `heading`."""
    known = np.array([values.get(name, 0.0) for name in ("a_lat", "a_long", "a_along")])
    return np.asarray(path_axes(v_n, values.get("heading", 0.0)).T @ known)


def path_axes(v_n: Array, heading: float) -> Array:
    """The matrix (3, 3) that makes (a_lat, a_long, a_along) of a_n (3,), for the velocity v_n (3,), m/s; its
    transpose makes a_n of them. `heading`: rad, for a slow vehicle."""
    u, v, w = v_n.tolist()
    c, s, cosine, sine = path_angles(u, v, w, heading)
    return np.array(
        [
            [-s, c, 0.0],
            [-c * sine, -s * sine, -cosine],
            [c * cosine, s * cosine, -sine],
        ]
    )
