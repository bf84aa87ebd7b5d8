"""Axes of a path, in which accelerations are given: Oh & Johnson, section II.A, eq 2, and along track.

For a velocity (u, v, w) in n with horizontal speed h and speed V, the rows of the matrix are unit vectors:
    right  (-v, u, 0) / h              a_lat:   level, positive in a right turn
    up     (u w, v w, -h^2) / (h V)    a_long:  normal to the velocity, in its vertical plane, positive up
    along  (u, v, w) / V               a_along: along the track
They are orthogonal: the accelerations are the matrix times a_n, and a_n is its transpose times them. Below
`MIN_COURSE_SPEED_M_S` over ground a vehicle has no course: its axes are level, and along its heading.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from onboard.arrays import Array

MIN_COURSE_SPEED_M_S: Final = 1.0  # Over ground; a slower vehicle has no course.


def path_angles(u: float, v: float, w: float, heading: float) -> tuple[float, float, float, float]:
    """Return cosine and sine of the course and of the climb angle of a velocity (m/s, in n).

    Below `MIN_COURSE_SPEED_M_S` the course is `heading` (rad), and the climb angle is 0. Compiled kernels call it,
    too.
    """
    h2 = u * u + v * v
    if h2 <= MIN_COURSE_SPEED_M_S * MIN_COURSE_SPEED_M_S:
        return np.cos(heading), np.sin(heading), 1.0, 0.0
    h, whole = np.sqrt(h2), np.sqrt(h2 + w * w)
    return u / h, v / h, h / whole, -w / whole


def acceleration_of(values: Mapping[str, float], v_n: Array) -> Array:
    """Return a_n (3,) of a vehicle with velocity v_n (3,), from its a_lat, a_long and a_along.

    Those missing in `values` are 0. At low speed the axes are along its `heading`.
    """
    known = np.array([values.get(name, 0.0) for name in ("a_lat", "a_long", "a_along")])
    return np.asarray(path_axes(v_n, values.get("heading", 0.0)).T @ known)


def path_axes(v_n: Array, heading: float) -> Array:
    """Return the matrix (3, 3) from a_n (3,) to (a_lat, a_long, a_along) for a velocity v_n (3,), m/s.

    Its transpose is the inverse. `heading`: rad, used at low speed.
    """
    u, v, w = v_n.tolist()
    c, s, cosine, sine = path_angles(u, v, w, heading)
    return np.array(
        [
            [-s, c, 0.0],
            [-c * sine, -s * sine, -cosine],
            [c * cosine, s * cosine, -sine],
        ]
    )
