"""The axes of ROS (REP 103) and Foxglove: the world's are east, north, up; a body's are forward, left, up."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_quaternion

ENU_NED: Final[Array] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # its own inverse
FLU_FRD: Final[Array] = np.diag([1.0, -1.0, -1.0])  # its own inverse


def flu_to_enu(q_nb: ArrayLike) -> Array:
    """The rotation (3, 3) that turns components in forward, left, up into east, north, up, of an attitude q_nb."""
    return np.asarray(ENU_NED @ matrix_from_quaternion(q_nb) @ FLU_FRD)
