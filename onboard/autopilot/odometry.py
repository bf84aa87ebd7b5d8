"""Our own state as MAVLink's ODOMETRY has it: pose in local NED, velocity and rates in the body."""

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.sent import Encoder
from onboard.autopilot.stream import Stream
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import NavState, Odometry


def odometry_of(state: NavState) -> Odometry | None:
    """The record to send; None while there is no state. The covariance of the body's velocity includes that of the
    attitude, by which the velocity is rotated into the body. `quality` is -1 when the state is not valid."""
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


class OdometryStream:
    """Frames for states, at most `rate_hz` per second of flight. (system, component) is the sender."""

    def __init__(self, system: int, component: int, *, rate_hz: float) -> None:
        self._encoder = Encoder(system, component)
        self.stream = Stream(rate_hz)
        self.can_send = False

    def frames(self, state: NavState) -> list[bytes]:
        """The frame of this state, if it is due; also when time has gone back, as after a reboot."""
        self.can_send = state.mean is not None
        if not self.can_send or not self.stream.is_due(state.t_ns):
            return []
        odometry = odometry_of(state)
        if odometry is None:
            return []
        return [self._encoder.encode(odometry)]


def upper(covariance: Array) -> tuple[float, ...]:
    """The upper triangle of a matrix (6, 6), row by row (21)."""
    return tuple(covariance[np.triu_indices(6)].tolist())
