"""The Gauss-Hermite filter: its rule, moments that it has exactly, and angles at the seam."""

import numpy as np
import pytest

from onboard.filters import Belief, FilterError, NotPositiveDefiniteError, gauss_hermite


@pytest.mark.parametrize(("order", "n"), [(2, 1), (3, 2), (5, 3)])
def test_the_rule_has_the_moments_of_a_gaussian_up_to_twice_its_order(order: int, n: int) -> None:
    points, weights = gauss_hermite.rule(n, order)
    assert len(points) == order**n
    assert np.all(weights > 0)
    double = {0: 1, 2: 1, 4: 3, 6: 15, 8: 105}
    for power in range(2 * order):
        moment = weights @ points[:, -1] ** power
        assert moment == pytest.approx(double.get(power, 0), abs=1e-12), power
    if n > 1 and order > 2:
        assert weights @ (points[:, 0] ** 2 * points[:, 1] ** 2) == pytest.approx(1.0)


def test_a_cubic_s_moments_are_exact_with_order_four_and_the_unscented_mean_is_not() -> None:
    """x^3 of N(1, 0.25): mean 1 + 3 s^2, variance 9 s^2 + 36 s^4 + 15 s^6 with s = 0.5."""
    belief = Belief(np.array([1.0]), np.array([[0.25]]))
    after = gauss_hermite.predict(belief, lambda rows: rows**3, np.array([[0.1]]), order=4)
    assert after.mean[0] == pytest.approx(1 + 3 * 0.25, rel=1e-12)
    assert after.covariance[0, 0] == pytest.approx(0.1 + 9 * 0.25 + 36 * 0.25**2 + 15 * 0.25**3, rel=1e-12)


def test_an_update_is_the_one_of_the_moments_seed_1() -> None:
    """Gain and covariance of the textbook, from the points' mean, covariance and cross-covariance."""
    rng = np.random.default_rng(1)
    A = rng.normal(0, 1, (2, 2))
    belief, R, y = Belief(rng.normal(0, 1, 2), A @ A.T + np.eye(2)), np.array([[0.3]]), np.array([0.7])
    points, weights = gauss_hermite.rule(2, 3)
    x = belief.mean + points @ np.linalg.cholesky(belief.covariance).T
    z = np.sin(x[:, :1]) * x[:, 1:]
    mean = weights @ z
    S = (z - mean).T @ (weights[:, None] * (z - mean)) + R
    K = (x - belief.mean).T @ (weights[:, None] * (z - mean)) / S
    found = gauss_hermite.update(belief, y, lambda rows: np.sin(rows[:, :1]) * rows[:, 1:], R)
    np.testing.assert_allclose(found.belief.mean, belief.mean + K @ (y - mean))
    np.testing.assert_allclose(found.belief.covariance, belief.covariance - K @ S @ K.T)
    np.testing.assert_allclose([found.innovation_covariance, found.predicted[None]], [S, mean[None]])


def test_what_it_cannot_do_is_refused() -> None:
    belief = Belief(np.zeros(2), np.eye(2))
    with pytest.raises(FilterError, match=r"order: must be at least 2, .* not 100\^4"):
        gauss_hermite.rule(4, 100)
    with pytest.raises(FilterError, match="process: gave states that are not finite"):
        gauss_hermite.predict(belief, lambda rows: rows * np.nan, np.eye(2))
    with pytest.raises(NotPositiveDefiniteError, match="covariance: not positive semi-definite"):
        gauss_hermite.predict(Belief(np.zeros(2), -np.eye(2)), lambda rows: rows, np.eye(2))
