"""Our own vehicle's model: the paper's where the two meet, and right where the paper's has its singularity."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry.rotations import matrix_from_euler
from onboard.models import own_motion, quadrotor
from onboard.models.quadrotor import ATTITUDE, RATES, VELOCITY

NONE = np.zeros(3)
INERTIA = np.array([4.856e-3, 4.856e-3, 8.801e-3])


def drawn(seed: int, count: int, angle: float = 0.4) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, own_motion.STATE_SIZE))
    rows[:, list(ATTITUDE)] = rng.uniform(-angle, angle, (count, 3))
    rows[:, 12:] *= 0.1
    return rows


def test_its_derivative_is_that_of_the_papers_quadrotor_seed_1() -> None:
    rows, h = drawn(1, 20), 1e-6
    rows[:, 12:] = 0.0
    u, torque = 4.1, np.array([0.2, -0.1, 0.01])
    craft = quadrotor.Airframe(Ir=0.0, gravity=own_motion.GRAVITY)
    paper = quadrotor.process(rows[:, :12], np.array([u, *torque]), h, craft)
    omega_dot = np.array([craft.arm * torque[0], craft.arm * torque[1], torque[2]]) / INERTIA
    force = np.array([0.0, 0.0, -u / craft.mass])
    ours = own_motion.process(rows, h, force, omega_dot, np.eye(3), INERTIA, 0.0)
    assert_allclose((ours[:, :12] - rows[:, :12]) / h, (paper - rows[:, :12]) / h, atol=2e-4)


def test_the_reference_frame_of_the_angles_does_not_matter_seed_2() -> None:
    rows, R_na, R_ca = drawn(2, 30), matrix_from_euler(0.3, -1.2, 2.0), matrix_from_euler(-0.2, 0.3, 0.25)
    force = np.array([0.3, -0.2, -9.0])
    other = own_motion.change_reference(rows, R_ca)
    assert_allclose(R_ca.T @ own_motion.rotations(other), own_motion.rotations(rows), atol=1e-12)
    a = own_motion.process(rows, 0.01, force, NONE, R_na, INERTIA, 0.0)
    c = own_motion.process(other, 0.01, force, NONE, R_na @ R_ca.T, INERTIA, 0.0)
    assert_allclose(R_ca.T @ own_motion.rotations(c), own_motion.rotations(a), atol=2e-4)  # of one midpoint step
    assert_allclose(c[:, list(VELOCITY)], a[:, list(VELOCITY)], atol=1e-5)
    assert_allclose(c[:, list(RATES)], a[:, list(RATES)])


def test_relative_to_the_present_attitude_the_angles_are_zero() -> None:
    rows = np.zeros((1, own_motion.STATE_SIZE))
    rows[0, 8] = 0.6
    R = own_motion.rotations(rows)[0]
    assert_allclose(own_motion.change_reference(rows, R.T)[0, [6, 8, 10]], 0.0, atol=1e-15)


def test_disturbances_are_taken_from_the_force_and_fade() -> None:
    rows = np.zeros((1, own_motion.STATE_SIZE))
    rows[0, list(own_motion.DISTURBANCE)] = [0.1, -0.2, 0.3]
    after = own_motion.process(rows, 0.1, np.array([0.1, -0.2, 0.3 - 9.80665]), NONE, np.eye(3), INERTIA, 0.5)
    assert_allclose(after[0, list(VELOCITY)], 0.0, atol=1e-15)
    assert_allclose(after[0, 12:15], np.exp(-0.05) * rows[0, 12:15])


def test_a_barometer_s_offset_stays_and_moves_nothing_seed_5() -> None:
    rows = drawn(5, 4)
    other = rows.copy()
    other[:, own_motion.OFFSET] += 7.0
    force = np.array([0.1, -0.2, -9.0])
    after, moved = (own_motion.process(r, 0.1, force, NONE, np.eye(3), INERTIA, 0.5) for r in (rows, other))
    assert_allclose(after[:, own_motion.OFFSET], rows[:, own_motion.OFFSET])
    assert_allclose(moved[:, :15], after[:, :15])


def test_the_attitude_covariance_is_of_a_rotation_vector_in_the_body_seed_3() -> None:
    rng = np.random.default_rng(3)
    mean = drawn(4, 1)[0]
    root = 1e-4 * rng.normal(size=(own_motion.STATE_SIZE, own_motion.STATE_SIZE))
    rows = mean + rng.normal(size=(20000, own_motion.STATE_SIZE)) @ root.T
    R = own_motion.rotations(mean[None])[0]
    small = R.T @ own_motion.rotations(rows)
    vectors = np.stack([small[:, 2, 1], small[:, 0, 2], small[:, 1, 0]], axis=1)
    covariance = own_motion.navigation_covariance(root @ root.T, mean)[6:9, 6:9]
    assert_allclose(np.cov(vectors.T), covariance, rtol=0.1, atol=2e-9)


@pytest.mark.parametrize("seed", [5, 6])
def test_a_midpoint_step_keeps_what_its_docstring_says(seed: int) -> None:
    rows = drawn(seed, 10)
    rows[:, list(RATES)] = 3.0 * rows[:, list(RATES)] / np.linalg.norm(rows[:, list(RATES)], axis=1)[:, None]
    force = np.array([0.0, 0.0, -9.8])
    once = own_motion.process(rows, 0.01, force, NONE, np.eye(3), INERTIA, 0.0)
    fine = rows
    for _ in range(100):
        fine = own_motion.process(fine, 1e-4, force, NONE, np.eye(3), INERTIA, 0.0)
    assert_allclose(once[:, list(ATTITUDE)], fine[:, list(ATTITUDE)], atol=1e-4)
