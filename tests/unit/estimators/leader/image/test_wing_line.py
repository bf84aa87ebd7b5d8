"""The measurement of a wing compared with projections and derivatives computed another way."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.image import measurement


def test_near_the_axis_the_measurement_is_in_radians_right_and_down() -> None:
    points = np.array([[[0.0, 0.0], [-0.02, 0.01], [0.03, -0.01]]])
    y, R_y, axes = measurement.from_points(points, np.array([[1e-3, 2e-3, 3e-3]]))
    np.testing.assert_allclose(axes[0], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(y[0], [0, 0, 0.05, -0.02], atol=2e-5)
    np.testing.assert_allclose(np.diag(R_y[0]), [1e-6, 1e-6, 13e-6, 13e-6], rtol=5e-3)


@pytest.mark.parametrize("seed", [4, 5])
def test_the_noise_is_that_of_the_points_by_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.6, 0.6, 2) + rng.uniform(-0.2, 0.2, (3, 2))
    sigmas = rng.uniform(1e-3, 3e-3, 3)
    _, R_y, axes = measurement.from_points(points[None], sigmas[None], measurement.M_MIDDLE)

    def coordinates(p: Array) -> Array:
        d = np.column_stack([np.ones(3), p])
        d /= np.linalg.norm(d, axis=1)[:, None]
        s = 2 * d @ axes[0, 1:].T / (1 + d @ axes[0, 0])[:, None]
        return np.concatenate([s[0], s[2] - s[1], 0.5 * (s[1] + s[2])])

    J = np.zeros((6, 6))
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-6
        J[:, i] = (coordinates(points + step.reshape(3, 2)) - coordinates(points - step.reshape(3, 2))) / 2e-6
    expected = J @ np.diag(np.repeat(sigmas, 2) ** 2) @ J.T
    np.testing.assert_allclose(R_y[0], expected, rtol=1e-5, atol=1e-14)
    _, without, _ = measurement.from_points(points[None], sigmas[None])
    np.testing.assert_array_equal(without[0], R_y[0, :4, :4])


def test_a_point_behind_the_camera_is_not_folded_to_the_front() -> None:
    """The opposite of the center is infinitely far away; all else in between."""
    ahead, aside, behind = (
        measurement.project_about(np.eye(3), *p) for p in ((1, 0.1, 0), (0, 1, 0), (-1, 0.1, 0))
    )
    assert 0.0 < ahead[0] < aside[0] == pytest.approx(2.0)
    assert behind[0] > 20.0
