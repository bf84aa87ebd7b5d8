"""The coordinated turn against an accurate integration, on a circle, and where it does not turn."""

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import rk4, white_acceleration
from onboard.filters.extended import complex_step
from onboard.models import coordinated_turn


def derivative(rows: Array) -> Array:
    _, _, vx, vy, rate = rows.T
    return np.stack([vx, vy, -rate * vy, rate * vx, 0 * rate], axis=1)


def test_one_step_equals_an_accurate_integration_seed_1() -> None:
    rows = np.random.default_rng(1).normal(0, [100, 100, 20, 20, 0.5], (50, 5))
    rows[0, 4], rows[1, 4] = 0.0, 1e-12
    fine = rows
    for _ in range(200):
        fine = rk4(derivative, fine, 0.01)
    np.testing.assert_allclose(coordinated_turn.process(rows, 2.0), fine, rtol=1e-7, atol=1e-7)


def test_integer_rows_are_numbers_and_complex_ones_differentiate() -> None:
    """Integers were truncated: [0, 0, 1, 1, 0] for a point that has moved by a tenth."""
    rows = np.array([[0, 0, 1, 1, 1], [5, -3, 10, 0, 0]])
    want = coordinated_turn.process(rows.astype(float), 0.1)
    np.testing.assert_array_equal(coordinated_turn.process(rows, 0.1), want)
    slope = complex_step(lambda x: coordinated_turn.process(x, 0.1))(rows.astype(float))
    for i in range(5):
        step = 1e-6 * np.eye(5)[i]
        by_difference = (
            coordinated_turn.process(rows + step, 0.1) - coordinated_turn.process(rows - step, 0.1)
        ) / 2e-6
        np.testing.assert_allclose(slope[:, :, i], by_difference, atol=1e-8)


def test_a_full_circle_comes_back() -> None:
    row = np.array([[3.0, 4.0, 10.0, 0.0, 0.2]])
    np.testing.assert_allclose(coordinated_turn.process(row, 2 * np.pi / 0.2), row, atol=1e-9)
    quarter = coordinated_turn.process(row, 0.5 * np.pi / 0.2)  # from x to y, about (3, 54)
    np.testing.assert_allclose(quarter[0, :4], [53.0, 54.0, 0.0, 10.0], atol=1e-9)


def test_its_noise_is_that_of_its_parts() -> None:
    Q = coordinated_turn.noise(0.5, 2.0, 0.01)
    np.testing.assert_allclose(Q[:4, :4], white_acceleration(0.5, 2.0, axes=2).Q)
    assert Q[4, 4] == 0.005
    assert not Q[4, :4].any()
