"""Axes of ROS (REP 103) and Foxglove.

The world's are east, north, up; a body's are forward, left, up.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_quaternion

ENU_NED: Final[Array] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # its own inverse
FLU_FRD: Final[Array] = np.diag([1.0, -1.0, -1.0])  # its own inverse
ELLIPSOID_SIGMAS: Final = 2.0  # half axes of a drawn ellipsoid
MIN_DRAWN_VARIANCE: Final = 1e-6  # m^2; viewers cannot draw a flat ellipsoid


def flu_to_enu(q_nb: ArrayLike) -> Array:
    """Return the rotation (3, 3) from forward, left, up to east, north, up, of q_nb."""
    return np.asarray(ENU_NED @ matrix_from_quaternion(q_nb) @ FLU_FRD)


def ellipsoid(P_n: ArrayLike) -> tuple[Array, Array]:
    """Return the 2-sigma ellipsoid of a covariance (3, 3) in n, in east, north, up.

    Its axes are the columns of a rotation (3, 3); its diameters are (3,).
    """
    squares, axes = np.linalg.eigh(ENU_NED @ np.asarray(P_n) @ ENU_NED.T)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return axes, 2.0 * ELLIPSOID_SIGMAS * np.sqrt(np.maximum(squares, MIN_DRAWN_VARIANCE))
