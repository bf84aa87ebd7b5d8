"""The first belief of the study's nine-state filters, compared with what geometry says."""

import numpy as np
import pytest

from onboard.geometry.rotations import matrix_from_euler
from onboard.models import camera_angles
from studies.relative_motion.noise import HONEST, PAPER, initial_belief

NOWHERE = np.zeros(3)


def test_initial_belief_ties_the_range_to_the_size() -> None:
    """On the axis r = b / (2 tan(alpha/2)), so var r = r^2 (var b / b^2 + var alpha / sin^2 alpha) and
    cov(r, b) = r var b / b."""
    size, size_sigma, distance = 2.0, 0.04, 30.0
    alpha = 2 * np.arctan(size / (2 * distance))
    R = np.diag([0.002, 0.003, 0.0015]) ** 2
    belief = initial_belief(HONEST, np.array([0.0, 0.0, alpha]), R, size, size_sigma, np.eye(3), NOWHERE)
    variance = distance**2 * (size_sigma**2 / size**2 + R[2, 2] / np.sin(alpha) ** 2)
    # 2nd order: 1/tan is convex, so mean and variance shift by about var(alpha)/alpha^2 = 5e-4
    assert belief.mean[:3] == pytest.approx([distance, 0.0, 0.0], rel=2e-3)
    assert belief.covariance[0, 0] == pytest.approx(variance, rel=5e-3)
    assert belief.covariance[0, 6] == pytest.approx(distance * size_sigma**2 / size, rel=2e-3)
    assert belief.covariance[6, 6] == pytest.approx(size_sigma**2, rel=1e-12)
    assert belief.covariance[1, 1] == pytest.approx((distance * 0.002) ** 2, rel=1e-2)
    assert belief.covariance[2, 2] == pytest.approx((distance * 0.003) ** 2, rel=1e-2)
    assert np.linalg.eigvalsh(belief.covariance)[0] > 0


def test_initial_belief_of_the_paper_is_diagonal_and_at_rest() -> None:
    belief = initial_belief(PAPER, np.array([0.1, -0.05, 0.08]), np.eye(3), 2.667, 0.05334, np.eye(3), NOWHERE)
    foot = 0.3048
    sigmas = [foot] * 6 + [0.05334] + [10 * foot] * 2
    assert belief.covariance == pytest.approx(np.diag(np.square(sigmas)), rel=1e-12)
    assert np.array_equal(belief.mean[3:], [0.0, 0.0, 0.0, 2.667, 0.0, 0.0])
    again = camera_angles.measure(belief.mean[None], np.eye(3), NOWHERE)[0]
    assert again == pytest.approx([0.1, -0.05, 0.08], rel=1e-12)


def test_initial_belief_turns_with_the_camera() -> None:
    yaw = matrix_from_euler(0.0, 0.0, 1.0)
    args = (np.array([0.1, 0.02, 0.08]), np.diag([0.002, 0.003, 0.0015]) ** 2, 2.0, 0.04)
    ahead = initial_belief(HONEST, *args, np.eye(3), NOWHERE)
    turned = initial_belief(HONEST, *args, yaw.T, NOWHERE)
    assert turned.mean[:3] == pytest.approx(yaw @ ahead.mean[:3], rel=1e-12)
    assert turned.covariance[:3, :3] == pytest.approx(yaw @ ahead.covariance[:3, :3] @ yaw.T, rel=1e-9, abs=1e-12)
    assert turned.covariance[:3, 6] == pytest.approx(yaw @ ahead.covariance[:3, 6], rel=1e-9)
