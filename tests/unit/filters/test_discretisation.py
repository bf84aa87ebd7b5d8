"""Discretisation against SciPy's exponential, closed forms and an exact solution."""

from collections.abc import Callable
from datetime import timedelta
from typing import Any

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from scipy.linalg import expm
from stonesoup.models.transition.linear import Singer

from onboard.arrays import Array
from onboard.filters import discretisation
from onboard.filters.belief import FilterError
from onboard.filters.discretisation import Discrete, rk4, van_loan, white_acceleration, wiener_acceleration


def matrix_fraction(A: Array, W: Array, dt: float) -> Discrete:
    """Lazarov et al. eqs 4-7, in one exponential."""
    n = len(A)
    whole = expm(np.block([[A, W], [np.zeros((n, n)), -A.T]]) * dt)
    F = expm(A * dt)
    return Discrete(F, whole[:n, n:] @ F.T)


def wiener(axes: int = 3) -> tuple[Array, Array]:
    A = np.kron(np.eye(3, k=1), np.eye(axes))
    return A, np.kron(np.diag([0.0, 0.0, 1.0]), np.eye(axes))


@pytest.mark.parametrize("dt", [0.01, 0.5, 7.0])
def test_van_loan_is_the_matrix_fraction_seed_1(dt: float) -> None:
    rng = np.random.default_rng(1)
    A, L = rng.normal(0, 1, (5, 5)) - 2 * np.eye(5), rng.normal(0, 1, (5, 2))
    expected, found = matrix_fraction(A, L @ L.T, dt), van_loan(A, L @ L.T, dt)
    np.testing.assert_allclose(found.F, expected.F, rtol=0, atol=1e-12 * np.abs(expected.F).max())
    # the fraction itself cancels at 7 s, where exp(-A dt) is 1e12
    np.testing.assert_allclose(found.Q, expected.Q, rtol=0, atol=(1e-3 if dt == 7.0 else 1e-12))


@pytest.mark.parametrize("dt", [0.02, 0.5, 30.0])
def test_wiener_acceleration_is_the_matrix_fraction(dt: float) -> None:
    A, W = wiener()
    for expected in (matrix_fraction(A, 0.2 * W, dt), van_loan(A, 0.2 * W, dt)):
        found = wiener_acceleration(dt, 0.2)
        np.testing.assert_allclose(found.F, expected.F, rtol=1e-12, atol=1e-300)
        np.testing.assert_allclose(found.Q, expected.Q, rtol=1e-12, atol=1e-12)


def test_white_acceleration_is_the_matrix_fraction_with_a_density_for_each_axis() -> None:
    A = np.kron(np.eye(2, k=1), np.eye(2))
    expected = matrix_fraction(A, np.diag([0.0, 0.0, 0.3, 0.7]), 0.4)
    found = white_acceleration(0.4, [0.3, 0.7], axes=2)
    np.testing.assert_allclose(found.F, expected.F, atol=1e-15)
    np.testing.assert_allclose(found.Q, expected.Q, atol=1e-15)


def test_the_numbers_of_one_axis() -> None:
    F, Q = wiener_acceleration(2.0, 3.0, axes=1)
    np.testing.assert_array_equal(F, [[1, 2, 2], [0, 1, 2], [0, 0, 1]])
    np.testing.assert_allclose(Q, 3 * np.array([[1.6, 2, 8 / 6], [2, 8 / 3, 2], [8 / 6, 2, 2]]), rtol=1e-15)


def test_eq_14_as_printed_is_indefinite() -> None:
    """Lazarov et al. print t^5/20 for all three variances."""
    t = 0.5
    printed = np.array(
        [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**5 / 20, t**4 / 8], [t**3 / 6, t**4 / 8, t**5 / 20]]
    )
    assert np.linalg.eigvalsh(printed)[0] < 0
    assert np.linalg.eigvalsh(wiener_acceleration(t, axes=1).Q)[0] > 0


def test_a_fast_decay_over_a_long_step_where_the_fraction_overflows() -> None:
    """x_dot = -a x + w: Q = (1 - exp(-2 a dt)) / 2a."""
    A, W = np.array([[-1000.0, 0.0], [0.0, -1e-3]]), np.diag([2.0, 2.0])
    F, Q = van_loan(A, W, 1.0)
    np.testing.assert_allclose(np.diag(Q), [1e-3, -np.expm1(-2e-3) / 1e-3], rtol=1e-12)
    assert F[1, 1] == pytest.approx(np.exp(-1e-3), rel=1e-13)
    with np.errstate(all="ignore"):
        assert not np.isfinite(matrix_fraction(A, W, 1.0).Q).all()


def test_an_array_of_steps_is_a_loop() -> None:
    dt = np.array([0.01, 0.7, 12.0])
    A, W = wiener()
    pairs: tuple[tuple[Callable[[Any], Discrete], Array], ...] = (
        (lambda t: van_loan(A, W, t), dt),
        (lambda t: wiener_acceleration(t, 0.2), dt),
        (lambda t: white_acceleration(t, by_axis=True), dt),
    )
    for function, steps in pairs:
        together = function(steps)
        for k, t in enumerate(steps):
            np.testing.assert_allclose(together.F[k], function(t).F, rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(together.Q[k], function(t).Q, rtol=1e-12, atol=1e-14)


def test_rk4_is_of_fourth_order() -> None:
    def turning(rows: Array) -> Array:
        return np.stack([rows[:, 1], -rows[:, 0]], axis=1)

    rows = np.array([[1.0, 0.0], [0.0, 2.0]])

    def error(dt: float) -> float:
        exact = np.stack([[np.cos(dt), -np.sin(dt)], [2 * np.sin(dt), 2 * np.cos(dt)]])
        return float(np.abs(rk4(turning, rows, dt) - exact).max())

    assert error(0.1) < 2e-7
    assert 28 < error(0.1) / error(0.05) < 36  # a local error of dt^5


@pytest.mark.parametrize("dt", [-0.1, float("nan"), float("inf"), np.array([0.1, -0.1])])
@pytest.mark.parametrize(
    "function",
    [
        lambda dt: van_loan(np.eye(2), np.eye(2), dt),
        wiener_acceleration,
        white_acceleration,
        lambda dt: rk4(lambda rows: rows, np.eye(2), dt if np.ndim(dt) == 0 else -1.0),
    ],
    ids=["van_loan", "wiener", "white", "rk4"],
)
def test_a_step_must_be_finite_and_not_negative(function: Callable[[Any], Any], dt: Any) -> None:
    with pytest.raises(FilterError, match=r"\bdt\b"):
        function(dt)


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (lambda: van_loan(np.eye(2), np.eye(3), 0.1), "W"),
        (lambda: van_loan(np.full((2, 2), np.nan), np.eye(2), 0.1), "A"),
        (lambda: van_loan(np.ones(2), np.eye(2), 0.1), "A"),
        (lambda: wiener_acceleration(0.1, -1.0), "q"),
        (lambda: wiener_acceleration(0.1, [1.0, 2.0]), "q"),
        (lambda: white_acceleration(0.1, float("nan")), "q"),
        (lambda: rk4(lambda rows: rows[:, :1], np.eye(2), 0.1), "derivative"),
    ],
)
def test_other_arguments_are_refused_by_name(function: Callable[[], Any], name: str) -> None:
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        function()


@pytest.mark.parametrize("by_axis", [False, True])
def test_discrete_white_acceleration_is_filterpy_s(by_axis: bool) -> None:
    F, Q = discretisation.discrete_white_acceleration(0.5, 3.0, axes=2, by_axis=by_axis)
    np.testing.assert_allclose(Q, Q_discrete_white_noise(2, 0.5, 3.0, block_size=2, order_by_dim=by_axis))
    np.testing.assert_allclose(F, discretisation.white_acceleration(0.5, 1.0, axes=2, by_axis=by_axis).F)
    _, each = discretisation.discrete_white_acceleration(np.array([0.5, 2.0]), [3.0, 1.0], axes=2)
    np.testing.assert_allclose(each[1], np.kron(np.outer([2.0, 2.0], [2.0, 2.0]), np.diag([3.0, 1.0])))
    with pytest.raises(FilterError, match="variance: must be one number, or one for each of 2 axes"):
        discretisation.discrete_white_acceleration(0.5, -1.0, axes=2)


def test_singer_s_model_is_stone_soup_s_and_has_its_two_limits() -> None:
    theirs = Singer(noise_diff_coeff=2 * 4.0 / 10.0, damping_coeff=1 / 10.0)
    F, Q = discretisation.singer(2.0, 10.0, 4.0, axes=1)
    step = timedelta(seconds=2.0)
    np.testing.assert_allclose(F, theirs.matrix(time_interval=step), rtol=1e-12)
    np.testing.assert_allclose(Q, np.asarray(theirs.covar(time_interval=step)), rtol=1e-6)
    long, short = discretisation.singer(1.0, 1e7, 1e7 / 2, axes=2), discretisation.singer(1.0, 1e-4, 5e3, axes=2)
    np.testing.assert_allclose(long.Q, discretisation.wiener_acceleration(1.0, 1.0, axes=2).Q, rtol=1e-5)
    np.testing.assert_allclose(short.Q[:4, :4], discretisation.white_acceleration(1.0, 1.0, axes=2).Q, rtol=1e-3)
    by_axis = discretisation.singer(2.0, 10.0, [4.0, 1.0], axes=2, by_axis=True)
    np.testing.assert_allclose(by_axis.Q[3:, 3:], Q / 4)
    with pytest.raises(FilterError, match="tau: must be positive"):
        discretisation.singer(1.0, 0.0)
