"""Errors shared by an aircraft's measurements: their covariances, and consistency of a filter with them."""

import math

import numpy as np

from onboard.filters.belief import Belief
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_vector
from onboard.models.intruder import motion
from onboard.models.intruder.attitude_error import (
    AttitudeErrorModel,
    ReportErrors,
    correct_attitude_error,
    with_attitude_error,
    with_report_errors,
)
from onboard.models.intruder.motion import MotionModel
from tests.support.intruder import ATTITUDE_ERROR, MODEL


def test_reported_positions_do_not_drift_with_our_own_position() -> None:
    """Reports with an error of 1.5 m of their own and our 1 m, both for a minute: the reported position, r_OT_n
    and bias together, drifts only by their own."""
    noise = MODEL._replace(gust=np.zeros(3), drift=math.sqrt(2.0 / 60.0))
    bias = np.array([[math.hypot(1.5, 1.0)] * 3, [2.0, 3.0, 10.0], [np.inf] * 3, [0.01, 0.5, 1.0]])
    dt = 0.1
    step = motion.step(dt, noise)
    shared = np.random.default_rng(1).uniform(-0.01, 0.01, (4, 3, 3))
    shared[:3] = 0.0
    Q = with_report_errors(step, ReportErrors(bias, shared), ATTITUDE_ERROR).Q
    H = np.eye(3, 15)
    H[:, 9:12] = bias[0] * np.eye(3)
    np.testing.assert_allclose(np.diag(H @ Q[0] @ H.T), 2 * dt / 60.0 * 1.5**2, rtol=0.01)
    np.testing.assert_array_equal(Q[2], with_attitude_error(step, ATTITUDE_ERROR).Q)  # no reports
    assert np.linalg.eigvalsh(Q).min() > -1e-12  # even where reports should be better than our own position
    np.testing.assert_array_equal(step.Q[:3, 9:12], 0.0)  # the cached step is as it was


def test_a_covariance_too_large_for_its_variances_is_limited_seed_2() -> None:
    rng = np.random.default_rng(2)
    shared = rng.uniform(-1.0, 1.0, (50, 3, 3)) * 10.0 ** rng.uniform(-6, 2, (50, 1, 1))
    bias = 10.0 ** rng.uniform(-2, 3, (50, 3))
    none = ATTITUDE_ERROR._replace(variances=np.array([0.0, 1.0, 0.3]))
    for noise in (MODEL, MODEL._replace(drift=0.0), MODEL._replace(drift=5.0)):
        for attitude_error in (ATTITUDE_ERROR, none):
            Q = with_report_errors(motion.step(0.1, noise), ReportErrors(bias, shared), attitude_error).Q
            scale = np.sqrt(np.maximum(np.diagonal(Q, axis1=1, axis2=2), 1e-18))
            assert np.linalg.eigvalsh(Q / (scale[:, :, None] * scale[:, None, :])).min() > -1e-9


def test_the_attitude_error_keeps_its_covariance_and_each_axis_its_time_constant() -> None:
    axes = matrix_from_quaternion(quaternion_from_vector([0.2, 0.5, -0.1])) @ np.diag([1e-3, 4e-3, 2e-3])
    attitude_error = AttitudeErrorModel(axes, np.array([1.0, 0.3, 0.5]), np.array([10.0, 60.0, 30.0]))
    noise = MotionModel(np.full(3, 2.5), 8.0, False, np.full(3, 0.3), 0.2, 60.0)
    step = with_attitude_error(motion.step(0.7, noise), attitude_error)
    at = motion.ATTITUDE_ERROR
    F, Q = step.F[at, at], step.Q[at, at]
    np.testing.assert_allclose(
        F @ attitude_error.covariance @ F.T + Q, attitude_error.covariance, rtol=1e-9, atol=1e-20
    )
    np.testing.assert_allclose(F @ axes[:, 1], np.exp(-0.7 / 60.0) * axes[:, 1], rtol=1e-12)


def test_a_correction_is_that_of_a_measurement_of_the_attitude_error_seed_10() -> None:
    """With a posterior of the rotation, the other states must be as after a measurement of it."""
    rng = np.random.default_rng(10)
    root = rng.normal(0, 1, (2, 15, 15)) * np.repeat([5.0, 1.0, 0.5, 1.0, 0.01], 3)[:, None]
    P, mean = root @ root.transpose(0, 2, 1), rng.normal(0, 1, (2, 15))
    measured, noise = np.array([0.004, -0.002, 0.003]), np.diag([1e-5, 2e-5, 3e-5])
    H = np.zeros((3, 15))
    H[:, motion.ATTITUDE_ERROR] = np.eye(3)
    for b in range(2):
        K = P[b] @ H.T @ np.linalg.inv(H @ P[b] @ H.T + noise)
        after, rest = mean[b] + K @ (measured - H @ mean[b]), P[b] - K @ H @ P[b]
        posterior = Belief(after[motion.ATTITUDE_ERROR], rest[motion.ATTITUDE_ERROR, motion.ATTITUDE_ERROR])
        found = correct_attitude_error(Belief(mean, P), posterior)
        np.testing.assert_allclose(found.mean[b, :12], after[:12], rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(found.mean[b, 12:], 0.0)
        np.testing.assert_allclose(found.covariance[b], rest, rtol=1e-5, atol=1e-9)
