"""Our own state as pose in local NED, and velocity and rates in the body."""

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import NavState, Odometry


def odometry_of(state: NavState) -> Odometry | None:
    """The record to send, None without a state; quality -1 marks an invalid state.

    The covariance of the body's velocity includes that of the attitude.
    """
    if state.mean is None or state.covariance is None or state.q_nb is None or state.omega_b is None:
        return None
    P, R_bn = np.array(state.covariance), matrix_from_quaternion(state.q_nb).T
    v_b = R_bn @ np.array(state.mean[3:6])
    x, y, z = v_b
    jacobian = np.zeros((6, 12))  # of v_b and the rates with respect to r, v, rotation in b, rates
    jacobian[:3, 3:6] = R_bn
    jacobian[:3, 6:9] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    jacobian[3:, 9:] = np.eye(3)
    pose = P[np.ix_((0, 1, 2, 6, 7, 8), (0, 1, 2, 6, 7, 8))]
    north, east, down = state.mean[:3]
    return Odometry(
        t_ns=state.t_ns,
        t_recv_ns=state.t_ns,
        r_OF_n=(north, east, down),
        q_nb=state.q_nb,
        v_F_b=tuple(v_b.tolist()),
        omega_b=state.omega_b,
        pose_covariance=upper(pose),
        velocity_covariance=upper(jacobian @ P @ jacobian.T),
        reset_counter=state.reset_count % 256,
        quality=state.quality if state.valid else -1,
    )


def upper(covariance: NDArray[np.float64]) -> tuple[float, ...]:
    """The upper triangle of a matrix (6, 6), row by row (21)."""
    return tuple(covariance[np.triu_indices(6)].tolist())


def full(triangle: tuple[float, ...]) -> NDArray[np.float64]:
    """The symmetric matrix (6, 6) of an upper triangle (21)."""
    covariance = np.zeros((6, 6))
    covariance[np.triu_indices(6)] = triangle
    return np.asarray(np.triu(covariance) + np.triu(covariance, 1).T)
