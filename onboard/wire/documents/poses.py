"""A detector's pose -> RelativePose: the camera's optical axes outside, c inside.

The optical axes are right, down and forward (OpenCV, ROS); those of c are forward, right and down. Without a
stated covariance, the position has the sigma of a point and POSITION of the range, and the rotation
ROTATION_SIGMA.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_matrix
from onboard.messages import DetectedPose, Quaternion, RelativePose, Vec3
from onboard.wire.documents.document import BadDocumentError

LONGEST_RANGE: Final = 1e5  # m
MIN_DEPTH_M: Final = 0.01  # along the optical axis: no aircraft is closer to a camera
POSITION_SHARE: Final = 0.05  # of the range, along the line of sight
ROTATION_SIGMA: Final = math.radians(10.0)
NORM_BOUNDS: Final = (0.5, 2.0)  # the least and the greatest length of a quaternion, which has length 1
ASYMMETRY_TOLERANCE: Final = 1e-4  # relative, for rounding
TO_C: Final = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # from the optical axes

Array = npt.NDArray[np.float64]
Rows = tuple[Vec3, Vec3, Vec3]


def relative_pose(pose: DetectedPose, sigma: float, at: str) -> RelativePose:
    """Convert the pose of one detection. Raises BadDocumentError, which names the field.

    `sigma` is the default of a point, in focal lengths.
    """
    if pose.position_m is None and pose.q is None:
        raise BadDocumentError(f"expected `position_m`, `q`, or both - at `$.{at}`")
    r_covariance = turn_covariance = None
    r = None if pose.position_m is None else _position(pose.position_m, f"{at}.position_m")
    q = None if pose.q is None else _rotation(pose.q, f"{at}.q")
    if pose.covariance is not None:
        whole = np.array(pose.covariance)
        parts = [part for known, part in ((r, slice(0, 3)), (q, slice(3, 6))) if known is not None]
        _check(whole[np.ix_(*[np.r_[tuple(parts)]] * 2)], f"{at}.covariance")
        r_covariance, turn_covariance = (rows_of(TO_C @ whole[p, p] @ TO_C.T) for p in (slice(0, 3), slice(3, 6)))
    elif r is not None:
        r_covariance = rows_of(guessed(np.array(r), sigma))
    return RelativePose(
        r_CL_c=r,
        r_covariance=None if r is None else r_covariance,
        q_cL=q,
        turn_covariance=None if q is None else turn_covariance or rows_of(ROTATION_SIGMA**2 * np.eye(3)),
    )


def guessed(r: Array, sigma: float) -> Array:
    """The default covariance (3, 3) of a position (3,)."""
    range_ = float(np.linalg.norm(r))
    line = np.outer(r, r) / range_**2
    covariance: Array = range_**2 * ((POSITION_SHARE**2 + sigma**2) * line + sigma**2 * (np.eye(3) - line))
    return covariance


def rows_of(P: Array) -> Rows:
    """A covariance (3, 3) as a record has it."""
    a, b, c = (tuple(row) for row in P.tolist())
    return a, b, c


def _position(position_m: Vec3, at: str) -> Vec3:
    right, down, forward = position_m
    if not math.hypot(*position_m) < LONGEST_RANGE:
        raise BadDocumentError(f"expected metres below {LONGEST_RANGE:g} - at `$.{at}`")
    if not forward > MIN_DEPTH_M:
        raise BadDocumentError(f"it is behind the camera; expected right, down, forward - at `$.{at}`")
    return forward, right, down


def _rotation(q: Quaternion, at: str) -> Quaternion:
    least, largest = NORM_BOUNDS
    if not least < math.hypot(*q) < largest:
        raise BadDocumentError(f"expected a quaternion w, x, y, z of length 1 - at `$.{at}`")
    w, x, y, z = quaternion_from_matrix(TO_C @ matrix_from_quaternion(q)).tolist()
    return w, x, y, z


def _check(P: Array, at: str) -> None:
    """Raise BadDocumentError unless P (k, k) can be a covariance."""
    if not np.isfinite(P).all():
        raise BadDocumentError(f"expected finite numbers - at `$.{at}`")
    if np.abs(P - P.T).max() > ASYMMETRY_TOLERANCE * np.abs(P).max():
        raise BadDocumentError(f"a covariance is symmetric - at `$.{at}`")
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError as error:
        raise BadDocumentError(f"a covariance is positive definite - at `$.{at}`") from error
