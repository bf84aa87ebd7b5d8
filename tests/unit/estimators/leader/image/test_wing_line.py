"""The measurement of a wing compared with projections and derivatives computed another way."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.image import measurement


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
