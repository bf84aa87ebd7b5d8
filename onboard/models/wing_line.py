"""What a camera sees of a leader's wing, without assuming that the wing lies in the image plane.

Measurement (4): the center's direction and the line from the left wingtip to the right one, as coordinates
(right, down) on the plane that touches the sphere of directions where the center was seen, rad. The projection is
stereographic: smooth everywhere but exactly opposite, so a leader thought to be behind the camera is not folded
over to the front of it, and for what is near it is the angle itself. Against Oh & Johnson's subtended angle
(eq 17) this adds the wing's slope, which shows the bank, and leaves its length to the leader's heading.
"""

from typing import Final

import numpy as np
from numba import njit

from onboard.geometry.rotations import Array
from onboard.models.leader_flight import CUBE, project_about
from onboard.models.relative_motion import ROWS

M: Final = 4
COMPONENTS: Final = ("right", "down", "wing_right", "wing_down")
UNITS: Final = ("rad", "rad", "rad", "rad")


def from_points(points: Array, sigmas: Array) -> tuple[Array, Array, Array]:
    """Measurements y (B, 4) and their noise R (B, 4, 4) from image points (B, 3, 2), the center, left and right
    one, whose coordinates have standard deviations `sigmas` (B, 3); and the axes (B, 3, 3) they are made in."""
    y, R, axes = _from_points(points, sigmas)
    return y, R, axes


@njit((CUBE, ROWS), cache=True, error_model="numpy")
def _from_points(points, sigmas):  # type: ignore[no-untyped-def]
    count = points.shape[0]
    y, R, axes = np.zeros((count, 4)), np.zeros((count, 4, 4)), np.zeros((count, 3, 3))
    for b in range(count):
        u, v = points[b, 0, 0], points[b, 0, 1]
        length, level = np.sqrt(1.0 + u * u + v * v), np.sqrt(1.0 + u * u)
        axes[b, 0, 0], axes[b, 0, 1], axes[b, 0, 2] = 1.0 / length, u / length, v / length
        axes[b, 1, 0], axes[b, 1, 1] = -u / level, 1.0 / level
        axes[b, 2, 0], axes[b, 2, 1] = -v / (length * level), -u * v / (length * level)
        axes[b, 2, 2] = level / length
        for p in range(3):
            u, v = points[b, p, 0], points[b, p, 1]
            at = project_about(axes[b], 1.0, u, v)
            length = np.sqrt(1.0 + u * u + v * v)
            below = length + axes[b, 0, 0] + axes[b, 0, 1] * u + axes[b, 0, 2] * v
            first = 0 if p == 0 else 2
            if p > 0:
                sign = 1.0 if p == 2 else -1.0
                y[b, 2] += sign * at[0]
                y[b, 3] += sign * at[1]
            # d at / d (u, v), of 2 e.q / (|q| + m.q)
            for i in range(2):
                iu = (2.0 * axes[b, 1 + i, 1] - at[i] * (u / length + axes[b, 0, 1])) / below
                iv = (2.0 * axes[b, 1 + i, 2] - at[i] * (v / length + axes[b, 0, 2])) / below
                for j in range(2):
                    ju = (2.0 * axes[b, 1 + j, 1] - at[j] * (u / length + axes[b, 0, 1])) / below
                    jv = (2.0 * axes[b, 1 + j, 2] - at[j] * (v / length + axes[b, 0, 2])) / below
                    R[b, first + i, first + j] += sigmas[b, p] ** 2 * (iu * ju + iv * jv)
    return y, R, axes


@njit(cache=True, error_model="numpy")
def order_tips_into(y, expected, ordered):  # type: ignore[no-untyped-def]
    """The measurement (m,) with its wingtips exchanged where that is nearer to what is expected (m,): a detector
    may take the left one for the right one, and an aircraft does not turn round between two images."""
    ordered[:] = y
    if y[2] * expected[2] + y[3] * expected[3] < 0:
        ordered[2], ordered[3] = -y[2], -y[3]
