"""The estimate of an earlier run of the daemon, as the prior of a warm start."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import Size
from onboard.filters.belief import Belief
from onboard.filters.discretisation import singer
from onboard.geometry.carried import carried, turn_rate, turning
from onboard.geometry.path_axes import acceleration_of
from onboard.messages import WarmState
from onboard.models.relative_motion import POSITION, SIZE, VELOCITY
from onboard.ownship import Ownship
from onboard.units import S_PER_NS

MOTION: Final = slice(0, 6)
UNSEEN_ACCELERATION_SIGMA: Final = np.array(
    [1.0, 1.0, 0.5]
)  # m/s^2, 1 sigma by axis, beyond that of the turn, unseen


class Prior(NamedTuple):
    """The leader's position from the autopilot's origin, velocity and acceleration, (3,) in n, at a time, and the
    covariance (6, 6) of the first two without the errors of our own."""

    t_ns: int
    r_OL_n: Array
    v_L_n: Array
    a_L_n: Array
    P: Array

    @property
    def flew(self) -> bool:
        """Whether it surely did not hover."""
        v = self.v_L_n[:2]
        return (
            float(v @ np.linalg.solve(self.P[3:5, 3:5], v)) > given.FLIGHT_SPEED_SIGMAS**2
            and math.hypot(*v) > given.MAX_HOVER_SPEED
        )

    def relative(self, t_ns: int, ownship: Ownship) -> Belief | None:
        """The leader at a later time.

        Position relative to us and velocity, (6,) and (6, 6), in n. None where our own position is not known, or
        too long after it."""
        pose, dt = ownship.pose_at(t_ns), (t_ns - self.t_ns) * S_PER_NS
        if pose is None or not 0.0 <= dt <= given.MAX_PRIOR_AGE_S or not np.isfinite(pose.r_OF_n).all():
            return None
        rate = turn_rate(self.v_L_n, self.a_L_n)
        r, v = carried(self.r_OL_n, self.v_L_n, rate, dt)
        P = spread(self.P, rate, dt)
        P[POSITION, POSITION] += (given.OWN_DRIFT_M_S * dt) ** 2 * np.eye(3)
        return Belief(np.concatenate([r - pose.r_OF_n, v]), P)


def spread(P: Array, rate: float, dt: float) -> Array:
    """The covariance (6, 6) of position and velocity `dt` s later.

    The acceleration that nobody sees is that of Singer (1970)."""
    F = np.eye(6)
    F[:3, 3:], F[3:, 3:] = turning(rate, dt)
    unseen = singer(dt, given.UNSEEN_ACCELERATION_TIME_S, UNSEEN_ACCELERATION_SIGMA**2)
    G = unseen.F[:6, 6:]
    spread_out: Array = F @ P @ F.T + (G * UNSEEN_ACCELERATION_SIGMA**2) @ G.T + unseen.Q[:6, :6]
    return spread_out


def prior_of(state: WarmState) -> Prior:
    """Return the leader's motion by a recorded state."""
    mean, P = np.array(state.estimate.mean), np.array(state.estimate.covariance)[MOTION, MOTION]
    dt, v_F = (state.t_ns - state.own.t_ns) * S_PER_NS, np.array(state.own.v_F_n)
    r_F = np.array(state.own.r_OF_n, float) + dt * v_F
    r_L, v_L = r_F + mean[POSITION], v_F + mean[VELOCITY]
    a_L = acceleration_of(dict(zip(state.estimate.components, mean.tolist(), strict=True)), v_L)
    return Prior(state.t_ns, r_L, v_L, a_L, 0.5 * (P + P.T))


def size_of(state: WarmState) -> Size:
    """The size that a state says."""
    mean, P = state.estimate.mean or (), state.estimate.covariance or ()
    return Size(mean[SIZE], math.sqrt(max(P[SIZE][SIZE], 0.0)))
