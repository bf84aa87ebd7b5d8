"""Models of the tracker papers: literal numbers, derivatives, exact motions, and the printed forms that fail."""

from collections.abc import Callable

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters.belief import FilterError
from onboard.filters.discretisation import van_loan, wiener_acceleration
from onboard.models import constant_acceleration, gnss_clock, pseudorange, radar, variable_turn


def states(seed: int, count: int = 5, n: int = 9) -> Array:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1, (count, n)) * np.resize([3e3, 100.0, 3.0], n)


def slopes(model: Callable[[Array], Array], rows: Array, step: float) -> Array:
    columns = []
    for i in range(rows.shape[1]):
        e = np.zeros(rows.shape[1])
        e[i] = step
        columns.append((model(rows + e) - model(rows - e)) / (2 * step))
    return np.stack(columns, axis=-1)


# ----------------------------------------------------------------------------------- constant acceleration


def test_constant_acceleration_is_its_matrix_seed_1() -> None:
    rows = states(1)
    after = constant_acceleration.process(rows, 0.3)
    F = wiener_acceleration(0.3, by_axis=True).F
    np.testing.assert_allclose(after, rows @ F.T, rtol=1e-14, atol=1e-9)


# --------------------------------------------------------------------------------------------------- radar


def test_radar_by_hand() -> None:
    rows = np.zeros((4, 9))
    rows[:, [0, 3, 6]] = [[0, 100, 0], [100, 0, 0], [0, -100, 0], [30, 40, 50]]
    expected = [[100, 0, 0], [100, np.pi / 2, 0], [100, np.pi, 0], [50 * 2**0.5, np.arctan2(3, 4), np.pi / 4]]
    np.testing.assert_allclose(radar.measure(rows), expected, atol=1e-15)


def test_eq_36_as_printed_folds_what_is_behind_to_the_front() -> None:
    rows = np.zeros((1, 9))
    rows[0, [0, 3, 6]] = [500.0, -1000.0, 100.0]
    x, y = rows[0, 0], rows[0, 3]
    right = radar.measure(rows)[0, 1]
    assert abs(np.arctan(x / y) - right) == pytest.approx(np.pi)
    np.testing.assert_allclose(radar.cartesian(radar.measure(rows))[0], [500, -1000, 100])


def test_radar_derivatives_seed_2() -> None:
    rows = states(2)
    np.testing.assert_allclose(radar.jacobian(rows), slopes(radar.measure, rows, 0.01), atol=1e-8)


# -------------------------------------------------------------------------------------------- variable turn


def test_a_steady_turn_goes_on_exactly() -> None:
    speed, omega, t = 100.0, 0.06, 2.0
    rows = np.array([[0, speed, 0, 0, 0, omega * speed, 50.0, 0, 0]])
    for _ in range(20):
        rows = variable_turn.process(rows, t / 20)
    angle = omega * t
    want = [speed / omega * np.sin(angle), speed * np.cos(angle), -speed * omega * np.sin(angle)]
    # SPEED_REGULARISATION_M_S makes the turn a ten-thousandth slower
    np.testing.assert_allclose(rows[0, :3], want, rtol=2e-3, atol=1e-4)
    assert np.hypot(rows[0, 1], rows[0, 4]) == pytest.approx(speed, rel=1e-5)


def test_a_steady_change_of_speed_goes_on_exactly() -> None:
    rows = np.array([[10.0, 80.0, 4.0, 0, 40.0, 2.0, 0, 0, 0]])
    after = variable_turn.process(rows, 0.5)[0]
    np.testing.assert_allclose(after[:6], [10 + 40.5, 82.0, 4.0, 20.25, 41.0, 2.0], rtol=1e-5)


def test_rk4_is_of_fourth_order_and_extra_states_stay_seed_3() -> None:
    rows = states(3, n=11)

    def flown(steps: int) -> Array:
        after = rows
        for _ in range(steps):
            after = variable_turn.process(after, 1.0 / steps)
        return after

    exact = flown(64)
    assert 12 < np.abs(flown(2) - exact).max() / np.abs(flown(4) - exact).max() < 22
    np.testing.assert_array_equal(exact[:, 9:], rows[:, 9:])


def test_the_printed_alpha_is_no_rate_and_bends_a_straight_line() -> None:
    """-v.a/|a|^2 is a time. Speeding up along a line it changes the acceleration, hugely when that is small."""
    v, a = np.array([100.0, 0, 0]), np.array([0.1, 0, 0])

    def jerk(alpha: float) -> Array:
        return np.asarray(-2 * alpha * a - 2 * alpha**2 * v)

    np.testing.assert_allclose(jerk(-(v @ a) / (v @ v)), 0, atol=1e-18)
    assert np.abs(jerk(-(v @ a) / (a @ a))).max() > 1e6


def test_eq_43_agrees_with_eq_42_for_the_squared_omega_c_only_seed_4() -> None:
    alpha, omega = 0.3, 0.2
    entry = 2 * alpha**2 + omega**2  # eq 42
    assert alpha**2 + np.sqrt(alpha**2 + omega**2) ** 2 == pytest.approx(entry)
    assert abs(alpha**2 + (alpha**2 + omega**2) ** 2 - entry) > 0.1


def test_coefficients_and_noise_seed_5() -> None:
    rows = states(5)
    alpha, omega = variable_turn.coefficients(rows)
    k = 2
    v, a = rows[k, [1, 4, 7]], rows[k, [2, 5, 8]]
    assert alpha[k] == pytest.approx(-(v @ a) / (v @ v), rel=1e-3)
    assert omega[k] == pytest.approx(np.linalg.norm(np.cross(v, a)) / (v @ v), rel=1e-3)
    A = np.array([[0, 1, 0], [0, 0, 1], [0, -(2 * alpha[k] ** 2 + omega[k] ** 2), -2 * alpha[k]]])
    fine = np.linspace(0, 0.4, 4001)
    columns = van_loan(np.broadcast_to(A, (4000, 3, 3)), np.zeros((3, 3)), fine[1:]).F[:, :, 2]
    columns = np.concatenate([[[0, 0, 1.0]], columns])
    integral = np.trapezoid(columns[:, :, None] * columns[:, None, :], fine, axis=0)
    Q = variable_turn.noise(rows, 0.4, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(Q[k, 3:6, 3:6], 2 * integral, rtol=1e-6)
    np.testing.assert_array_equal(Q[k, :3, 3:], 0)
    np.testing.assert_allclose(variable_turn.noise(rows[k], 0.4)[6:, 6:], Q[k, 6:, 6:] / 3, rtol=1e-12)


@pytest.mark.parametrize("dt", [0.01, 0.1, 1.0, 5.0])
@pytest.mark.parametrize("turning", [1.0, 30.0])
def test_noise_is_van_loan_s_for_short_steps_and_long_seed_7(dt: float, turning: float) -> None:
    rows = states(7, 40)
    rows[:, [2, 5, 8]] *= turning
    alpha, omega = variable_turn.coefficients(rows)
    found = variable_turn.noise(rows, dt)[:, :3, :3]
    for k in range(40):
        A = np.array([[0, 1, 0], [0, 0, 1], [0, -(2 * alpha[k] ** 2 + omega[k] ** 2), -2 * alpha[k]]])
        right = van_loan(A, np.diag([0.0, 0, 1]), dt).Q
        np.testing.assert_allclose(found[k], right, rtol=1e-9, atol=1e-12 * np.abs(right).max())
        assert np.linalg.eigvalsh(found[k] / right.max())[0] > -1e-15


@pytest.mark.parametrize(("dt", "q"), [(-0.1, 1.0), (float("nan"), 1.0), (0.1, -1.0), (0.1, float("nan"))])
def test_noise_of_no_step_or_of_no_density_is_refused(dt: float, q: float) -> None:
    with pytest.raises(FilterError):
        variable_turn.noise(states(8), dt, q)


def test_standing_still_is_finite() -> None:
    rows = np.zeros((1, 9))
    assert np.array_equal(variable_turn.process(rows, 0.1), rows)
    np.testing.assert_allclose(
        variable_turn.noise(rows, 0.1), wiener_acceleration(0.1, by_axis=True).Q[None], rtol=1e-12
    )


# ---------------------------------------------------------------------------------------------------- GNSS


def test_the_clock_drifts() -> None:
    rows = np.array([[0, 1.0, 0, 0, 0, 0, 0, 0, 0, 100.0, -2.0]])
    after = gnss_clock.process(rows, 0.5)
    np.testing.assert_allclose(after[0, 9:], [99.0, -2.0])
    Q = gnss_clock.noise(rows, 0.5, 1.0, clock=0.3, drift=0.2)[0]
    np.testing.assert_allclose(Q[9:, 9:], [[0.2 * 0.125 / 3 + 0.15, 0.025], [0.025, 0.1]])
    np.testing.assert_array_equal(Q[:9, 9:], 0)
    np.testing.assert_allclose(Q[:9, :9], variable_turn.noise(rows, 0.5)[0])
    assert Q[8, 8] > 0  # which eq 49 leaves out


def scene(seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return states(seed, n=11), rng.normal(0, 1.5e7, (4, 3)), rng.normal(0, 2e3, (4, 3))


def test_pseudoranges_by_hand() -> None:
    rows = np.zeros((1, 11))
    rows[0, [1, 9, 10]] = [10.0, 7.0, 0.5]
    ranges = pseudorange.measure(rows, np.array([[3e7, 0, 4e7]]), np.array([[0.0, 50.0, 100.0]]))
    np.testing.assert_allclose(ranges, [[5e7 + 7, -6 + 80 + 0.5]])


def test_pseudorange_derivatives_and_appendix_b_as_printed_seed_6() -> None:
    rows, position, velocity = scene(6)
    slope = pseudorange.jacobian(rows, position, velocity)
    numeric = slopes(lambda r: pseudorange.measure(r, position, velocity), rows, 10.0)
    np.testing.assert_allclose(slope, numeric, atol=2e-8)
    d, d_dot = position[0] - rows[0, [0, 3, 6]], velocity[0] - rows[0, [1, 4, 7]]
    r = np.linalg.norm(d)
    rate = d @ d_dot / r
    found = numeric[0, 4, [0, 3, 6]]
    np.testing.assert_allclose(-d_dot / r + rate * d / r**2, found, atol=1e-8)
    assert np.abs(-d / r + rate * d / r**2 - found).max() > 0.1  # as printed
