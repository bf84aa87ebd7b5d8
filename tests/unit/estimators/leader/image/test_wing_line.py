"""The measurement of a wing compared with projections and derivatives computed another way."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.image import measurement
from onboard.estimators.leader.image.shape import shape_of


def test_near_the_axis_the_measurement_is_in_radians_right_and_down() -> None:
    wing = measurement.measure_wing([(0.0, 0.0), (-0.02, 0.01), (0.03, -0.01)], [1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose(wing.axes, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(wing.y, [0, 0, 0.05, -0.02], atol=2e-5)
    np.testing.assert_allclose(np.diag(wing.rows.R), [1e-6, 1e-6, 13e-6, 13e-6], rtol=5e-3)


@pytest.mark.parametrize("seed", [4, 5])
def test_the_noise_is_that_of_the_points_by_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.6, 0.6, 2) + rng.uniform(-0.2, 0.2, (3, 2))
    sigmas = rng.uniform(1e-3, 3e-3, 3)
    wing = measurement.measure_wing(points.tolist(), sigmas.tolist(), middle=True)
    R_y, axes = wing.rows.R, wing.axes

    def coordinates(p: Array) -> Array:
        d = np.column_stack([np.ones(3), p])
        d /= np.linalg.norm(d, axis=1)[:, None]
        s = 2 * d @ axes[1:].T / (1 + d @ axes[0])[:, None]
        return np.concatenate([s[0], s[2] - s[1], 0.5 * (s[1] + s[2])])

    J = np.zeros((6, 6))
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-6
        J[:, i] = (coordinates(points + step.reshape(3, 2)) - coordinates(points - step.reshape(3, 2))) / 2e-6
    expected = J @ np.diag(np.repeat(sigmas, 2) ** 2) @ J.T
    np.testing.assert_allclose(R_y, expected, rtol=1e-5, atol=1e-14)
    without = measurement.measure_wing(points.tolist(), sigmas.tolist())
    np.testing.assert_allclose(without.rows.R, R_y[:4, :4], rtol=1e-12)


def test_the_noise_of_our_attitude_turns_a_wing_and_moves_a_box_seed_6() -> None:
    """By small rotations of all directions; a box moves as a whole, and becomes no larger."""
    rng = np.random.default_rng(6)
    points = np.array([0.3, -0.2]) + np.array([[0.0, 0.0], [-0.03, 0.01], [0.03, -0.01]])
    wing = measurement.measure_wing(points.tolist(), [1e-3] * 3)

    def turned(rotation: Array) -> Array:
        d = np.column_stack([np.ones(3), points])
        d /= np.linalg.norm(d, axis=1)[:, None]
        d += np.cross(rotation, d)
        s = 2 * d @ wing.axes[1:].T / (1 + d @ wing.axes[0])[:, None]
        return np.concatenate([s[0], s[2] - s[1]])

    J = np.column_stack([(turned(1e-6 * e) - turned(-1e-6 * e)) / 2e-6 for e in np.eye(3)])
    noise_c = np.diag(rng.uniform(0.5, 2.0, 3)) * 1e-4
    added = wing.with_attitude_noise(noise_c).rows.R - wing.rows.R
    np.testing.assert_allclose(added, J @ noise_c @ J.T, atol=1e-3 * np.abs(added).max())
    shape = shape_of(Config(aircraft="quadrotor"))
    sides = (0.26, -0.2), (0.3, -0.22), (0.34, -0.2), (0.3, -0.18)
    box = wing._replace(rows=measurement.rows_of_box(wing.axes, sides, 0.05, shape))
    more = box.with_attitude_noise(noise_c).rows.R - box.rows.R
    np.testing.assert_allclose(more[:2, :2], added[:2, :2], rtol=1e-9)
    assert np.abs(more[2:]).max() == 0.0
