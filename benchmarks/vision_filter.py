"""One prediction and one update of the nine-state vision filter: ours against filterpy's, on the same input."""

from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter

from onboard.estimators._leader_noise import HONEST, initial_belief, process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief
from onboard.geometry.rotations import wrap_angle
from onboard.models import camera_angles, relative_motion

SIZE, DT = 2.667, 0.02
ANGLES = np.array([0.05, -0.03, 0.09])
R = np.diag([0.0018, 0.0018, 0.0026]) ** 2
R_CN, R_FC_N = np.eye(3), np.zeros(3)
V, A = np.array([20.0, 0.0, 0.0]), np.array([0.0, 2.4, 0.0])
FOLLOWER = relative_motion.FollowerMotion(V, V + DT * A, A, A)
START = initial_belief(HONEST, ANGLES, R, SIZE, 0.02 * SIZE, R_CN, R_FC_N)
Q = np.diag(process_noise(HONEST, SIZE) * DT)


class Timing(NamedTuple):
    """Medians over rounds, microseconds per prediction and update; the quartiles of the rounds' ratios."""

    ours_us: float
    theirs_us: float
    ratio: float
    ratio_low: float
    ratio_high: float


def measure(rounds: int = 15, steps: int = 100) -> Timing:
    """Time both in turn, so that a busy machine slows both alike."""
    ours, theirs = np.empty(rounds), np.empty(rounds)
    for k in range(rounds):
        ours[k] = _time(_ours, steps)
        theirs[k] = _time(_theirs, steps)
    low, median, high = np.quantile(theirs / ours, [0.25, 0.5, 0.75])
    return Timing(float(np.median(ours)), float(np.median(theirs)), float(median), float(low), float(high))


def _time(steps_of: Callable[[int], Belief], steps: int) -> float:
    start = perf_counter()
    steps_of(steps)
    return (perf_counter() - start) / steps * 1e6


def _ours(steps: int) -> Belief:
    weights, belief = unscented.julier_weights(relative_motion.N), START
    for _ in range(steps):
        belief = unscented.predict(
            belief,
            lambda rows: relative_motion.process(rows, DT, FOLLOWER, HONEST.hover_speed),
            Q,
            weights,
        )
        belief = unscented.update(
            belief,
            ANGLES,
            lambda rows: camera_angles.measure(rows, R_CN, R_FC_N),
            R,
            weights,
            camera_angles.ANGULAR,
        ).belief
    return belief


def _theirs(steps: int) -> Belief:
    """The models are ours, called for one sigma point at a time, as filterpy does."""
    n = relative_motion.N
    peer: Any = UnscentedKalmanFilter(
        dim_x=n,
        dim_z=camera_angles.M,
        dt=DT,
        hx=lambda x: camera_angles.measure(x[None], R_CN, R_FC_N)[0],
        fx=lambda x, dt: relative_motion.process(x[None], dt, FOLLOWER, HONEST.hover_speed)[0],
        points=JulierSigmaPoints(n, kappa=3.0 - n),
        residual_z=lambda a, b: wrap_angle(a - b),
    )
    peer.x, peer.P, peer.Q, peer.R = START.mean.copy(), START.covariance.copy(), Q, R
    for _ in range(steps):
        peer.predict()
        peer.update(ANGLES)
    return Belief(peer.x, peer.P)


def agree() -> bool:
    """Whether both arrive at the same belief; a ratio of different results means nothing."""
    ours, theirs = _ours(50), _theirs(50)
    sigma = np.sqrt(np.diag(ours.covariance))
    return bool(np.all(np.abs(ours.mean - theirs.mean) < 1e-9 * sigma))
