"""The problem of Oh & Johnson: nine states of a leader seen by a camera, predict and update."""

from typing import Any, Final

import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter

from onboard.arrays import Array
from onboard.estimators.oh_johnson.noise import HOVER_SPEED, first_belief, process_noise
from onboard.filters import Belief, unscented
from onboard.geometry.rotations import wrap_angle
from onboard.models import camera_angles, relative_motion

N: Final = relative_motion.STATE_SIZE
SIZE, DT, EPS = 2.667, 0.02, HOVER_SPEED
ANGLES = np.array([0.05, -0.03, 0.09])
R = np.diag([0.0018, 0.0018, 0.0026]) ** 2
R_CN, R_FC_N = np.eye(3), np.zeros(3)
V, A = np.array([20.0, 0.0, 0.0]), np.array([0.0, 2.4, 0.0])
FOLLOWER = relative_motion.FollowerMotion(V, V + DT * A, A, A)
START = first_belief(ANGLES, SIZE, 0.02 * SIZE, R_CN, R_FC_N)
Q = process_noise(SIZE) * DT
WEIGHTS: Final = unscented.julier_weights(N)
RULE: Final = unscented.rule(WEIGHTS, N, camera_angles.MEASUREMENT_SIZE, camera_angles.ANGULAR)


def process(rows: Array) -> Array:
    """Advance the leader's motion by DT, compiled."""
    return relative_motion.process(rows, DT, FOLLOWER, EPS)


def measure(rows: Array) -> Array:
    """Return the camera's measurement, compiled."""
    return camera_angles.measure(rows, R_CN, R_FC_N)


def ours(steps: int) -> Belief:
    """Run the unscented filter, a step at a time."""
    belief: Any = START
    for _ in range(steps):
        belief = unscented.step(belief, process, Q, ANGLES, measure, R, RULE)
    return Belief(belief.mean, belief.covariance)


def ours_in_two_calls(steps: int, start: Belief = START, angles: Array = ANGLES) -> Belief:
    """Run it by a prediction and an update, for one filter or a batch, as the daemon does."""
    belief = start
    for _ in range(steps):
        belief = unscented.predict(belief, process, Q, WEIGHTS)
        belief = unscented.update(belief, angles, measure, R, WEIGHTS, camera_angles.ANGULAR).belief
    return belief


def batch(count: int) -> Any:
    """Return a run that advances `count` filters in one call."""
    start = Belief(np.tile(START.mean, (count, 1)), np.tile(START.covariance, (count, 1, 1)))
    angles = np.tile(ANGLES, (count, 1))
    return lambda steps: ours_in_two_calls(steps, start, angles)


def filterpy(steps: int) -> Belief:
    """Run filterpy with the equations for one point at a time in NumPy, as its documentation does."""
    return _filterpy(steps, fx, hx)


def filterpy_compiled(steps: int) -> Belief:
    """Run filterpy with our compiled models."""
    return _filterpy(steps, lambda x, _: process(x[None])[0], lambda x: measure(x[None])[0])


def fx(x: Array, dt: float) -> Array:
    """Integrate eqs 2 and 5-10 by RK4."""
    half = 0.5 * (FOLLOWER.v0 + FOLLOWER.v1), 0.5 * (FOLLOWER.a0 + FOLLOWER.a1)
    k1 = derivative(x, FOLLOWER.v0, FOLLOWER.a0)
    k2 = derivative(x + 0.5 * dt * k1, *half)
    k3 = derivative(x + 0.5 * dt * k2, *half)
    k4 = derivative(x + dt * k3, FOLLOWER.v1, FOLLOWER.a1)
    return np.asarray(x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))


def derivative(x: Array, v_F: Array, a_F: Array) -> Array:
    """Return the derivative of one state."""
    U, V_, W = x[3:6] + v_F
    lat, up = x[7], x[8]
    across = np.sqrt(U**2 + V_**2 + EPS**2)
    climb = up / (across * np.sqrt(across**2 + W**2))
    a_L = np.array([climb * U * W - lat * V_ / across, climb * V_ * W + lat * U / across, -climb * (U**2 + V_**2)])
    return np.concatenate([x[3:6], a_L - a_F, np.zeros(3)])


def hx(x: Array) -> Array:
    """Return eq 14 of one state."""
    r_c = R_CN @ (x[:3] - R_FC_N)
    alpha = 2 * np.arctan2(x[6], 2 * np.linalg.norm(r_c))
    return np.array([np.arctan2(r_c[1], r_c[0]), np.arctan2(r_c[2], r_c[0]), alpha])


def _filterpy(steps: int, fx: Any, hx: Any) -> Belief:
    points = JulierSigmaPoints(N, kappa=3.0 - N)
    peer: Any = UnscentedKalmanFilter(N, 3, DT, hx, fx, points, residual_z=lambda a, b: wrap_angle(a - b))
    peer.x, peer.P, peer.Q, peer.R = START.mean.copy(), START.covariance.copy(), Q, R
    for _ in range(steps):
        peer.predict()
        peer.update(ANGLES)
    return Belief(peer.x, peer.P)


def agree() -> bool:
    """Whether all of them compute the same; otherwise no ratio is meaningful."""
    expected = ours(5)
    others = [ours_in_two_calls(5), filterpy(5), filterpy_compiled(5)]
    return all(np.allclose(belief.mean, expected.mean, rtol=1e-9, atol=1e-12) for belief in others)
