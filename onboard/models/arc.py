"""Closest approach of an aircraft that keeps its turn to one that flies straight."""

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FLOAT, MAKING, ROWS, VECTOR, kernel


def first_approach(rows: Array, v_F: Array, horizon: float) -> Array:
    """Return time (s), distance (m) and vector (3) of the first closest approach, (k, 5).

    `rows` (k, 7) are the other's position and velocity relative to us, and its turn rate (rad/s, positive right).
    v_F (3,) is our velocity in n. The first zero of the squared distance's slope, at most `horizon` s ahead, is
    searched in steps, and then by bisection.
    """
    found: Array = _first_approach(rows, v_F, horizon)
    return found


@kernel((ROWS, VECTOR, FLOAT), **MAKING)
def _first_approach(rows, v_F, horizon):
    step = 0.5  # s
    found = np.empty((rows.shape[0], 5))
    p = np.empty(3)
    for k in range(rows.shape[0]):
        rate = rows[k, 6]
        north, east = rows[k, 3] + v_F[0], rows[k, 4] + v_F[1]
        low, high, t = 0.0, -1.0, 0.0
        for _ in range(200):
            angle = rate * t
            c, s = np.cos(angle), np.sin(angle)
            if abs(angle) < 1e-6:
                along, across = t, 0.5 * rate * t * t
            else:
                along, across = s / rate, (1.0 - c) / rate
            p[0] = rows[k, 0] + along * north - across * east - v_F[0] * t
            p[1] = rows[k, 1] + along * east + across * north - v_F[1] * t
            p[2] = rows[k, 2] + rows[k, 5] * t
            slope = (
                p[0] * (c * north - s * east - v_F[0]) + p[1] * (c * east + s * north - v_F[1]) + p[2] * rows[k, 5]
            )
            if slope >= 0.0:
                high = t
            else:
                low = t
            if high == 0.0 or low >= horizon or (high > 0.0 and high - low < 1e-4):
                break
            t = 0.5 * (low + high) if high > 0.0 else low + step
        found[k, 0] = t
        found[k, 1] = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        for i in range(3):
            found[k, 2 + i] = p[i]
    return found
