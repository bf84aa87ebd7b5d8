"""Our unscented filter against filterpy's, on the nine-state vision problem, over one minute's first seconds.

Both draw the same points (n + kappa = 3), and both draw them anew after the prediction.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter

from onboard.arrays import Array
from onboard.estimators.oh_johnson.noise import process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief
from onboard.geometry.rotations import matrix_from_quaternion, wrap_angle
from onboard.models import camera_angles, relative_motion
from simlink.scenarios.scenario import load_scenario
from studies.relative_motion.flight import Flight, fly
from studies.relative_motion.formation import ASSUMED_SIZE_M, SIZE_SIGMA
from studies.relative_motion.methods import TUNED_NOISE
from studies.relative_motion.noise import PAPER, Noise, initial_belief
from tests.conformance.problems import in_sigmas

SCENARIO = load_scenario("formation")
WEIGHTS = unscented.julier_weights(relative_motion.STATE_SIZE)
STEPS = 600
TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(SCENARIO, seed=4, duration=13.0)


def theirs(belief: Belief, Q: Array) -> Any:
    n = relative_motion.STATE_SIZE
    filter_ = UnscentedKalmanFilter(
        dim_x=n,
        dim_z=3,
        dt=0.02,
        hx=lambda x, R_cn: camera_angles.measure(x[None], R_cn, np.zeros(3))[0],
        fx=lambda x, dt, follower, eps: relative_motion.process(x[None], dt, follower, eps)[0],
        points=JulierSigmaPoints(n, kappa=3.0 - n),
        residual_z=lambda a, b: wrap_angle(a - b),
    )
    filter_.x, filter_.P, filter_.Q = belief.mean.copy(), belief.covariance.copy(), Q
    return filter_


@pytest.mark.parametrize("noise", [PAPER, TUNED_NOISE], ids=["paper", "tuned"])
def test_predict_and_update_equal_filterpy_over_600_steps_seed_4(flight: Flight, noise: Noise) -> None:
    sigma = SCENARIO.camera.sigma_px / SCENARIO.camera.f_px
    constant = np.diag([1.0, 1.0, 2.0]) * sigma**2
    R = constant if noise.angles_deg is None else np.diag(np.radians(noise.angles_deg) ** 2)
    angles = camera_angles.angles_from_points(flight.image_points[0])
    R_cn = matrix_from_quaternion(flight.nav_q_nb[0]).T
    belief = initial_belief(noise, angles, R, ASSUMED_SIZE_M, SIZE_SIGMA, R_cn, np.zeros(3))
    Q = process_noise(ASSUMED_SIZE_M, noise.walks) * 0.02
    other = theirs(belief, Q)
    worst, updates = np.zeros(2), 0
    for k in range(1, STEPS + 1):
        v, a = flight.nav_v_F_n, flight.nav_a_F_n
        follower = relative_motion.FollowerMotion(v[k - 1], v[k], a[k - 1], a[k])
        process = _process(follower, noise.hover_speed)
        belief = unscented.predict(belief, process, Q, WEIGHTS)
        other.predict(follower=follower, eps=noise.hover_speed)
        worst = np.maximum(worst, in_sigmas(belief, other.x, other.P))
        if k % 2 or not np.isfinite(flight.image_points[k // 2]).all():
            continue
        angles = camera_angles.angles_from_points(flight.image_points[k // 2])
        R_cn = matrix_from_quaternion(flight.nav_q_nb[k]).T
        update = unscented.update(belief, angles, _measure(R_cn), R, WEIGHTS, camera_angles.ANGULAR)
        other.update(angles, R=R, R_cn=R_cn)
        belief, updates = update.belief, updates + 1
        worst = np.maximum(worst, in_sigmas(belief, other.x, other.P))
        np.testing.assert_allclose(update.innovation, other.y, rtol=0, atol=TOLERANCE * np.sqrt(np.diag(R)).min())
        np.testing.assert_allclose(update.innovation_covariance, other.S, rtol=TOLERANCE, atol=1e-18)
        assert update.nis == pytest.approx(float(other.y @ np.linalg.solve(other.S, other.y)), rel=1e-7, abs=1e-9)
    assert updates > 200
    assert np.all(worst < TOLERANCE), worst


def _process(follower: relative_motion.FollowerMotion, eps: float) -> Callable[[Array], Array]:
    return lambda rows: relative_motion.process(rows, 0.02, follower, eps)


def _measure(R_cn: Array) -> Callable[[Array], Array]:
    return lambda rows: camera_angles.measure(rows, R_cn, np.zeros(3))
