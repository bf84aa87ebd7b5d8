"""The noise-augmented unscented filter: equal to the additive one where noise is a sum, better where it is not."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.augmented import Rule, additive, predict_augmented, step_augmented, update_augmented
from onboard.filters.belief import Belief
from onboard.filters.unscented import julier_weights, scaled_weights
from tests.support.filter_problems import spd

RULES: dict[str, Rule] = {
    "julier": julier_weights,
    "scaled 1": lambda n: scaled_weights(n, 1.0, 2.0),
    "scaled 0.1": lambda n: scaled_weights(n, 0.1, 2.0),
}
rules = pytest.mark.parametrize("rule", RULES.values(), ids=RULES)


def problem(seed: int, n: int = 4, m: int = 2) -> tuple[Belief, Array, Array, Array, Array, Array]:
    rng = np.random.default_rng(seed)
    belief, F, Q = Belief(rng.normal(0, 2, n), spd(rng, n)), rng.normal(0, 1, (n, n)), spd(rng, n)
    return belief, F, Q, rng.normal(0, 1, (m, n)), spd(rng, m), rng.normal(0, 2, m)


@rules
def test_equals_the_additive_filter_on_a_linear_model_seed_1(rule: Rule) -> None:
    belief, F, Q, H, R, y = problem(1)
    prior = unscented.predict(belief, lambda r: r @ F.T, Q, rule(4))
    expected = unscented.update(prior, y, lambda r: r @ H.T, R, rule(4))
    found = predict_augmented(belief, additive(lambda r: r @ F.T), Q, rule)
    np.testing.assert_allclose(found.mean, prior.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.covariance, prior.covariance, rtol=1e-9, atol=1e-9)
    both = (
        update_augmented(found, y, additive(lambda r: r @ H.T), R, rule),
        step_augmented(belief, additive(lambda r: r @ F.T), Q, y, additive(lambda r: r @ H.T), R, rule),
    )
    for update in both:
        for a, b in zip((*update.belief, *update[1:-1]), (*expected.belief, *expected[1:-1]), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


@rules
def test_one_draw_is_the_dense_formula_seed_7(rule: Rule) -> None:
    """Eqs 8-12 as written, with sums over all points, on a bent model."""
    belief, F, Q, H, R, y = problem(7)
    belief, Q, R = Belief(0.1 * belief.mean, 0.01 * belief.covariance), 0.01 * Q, 0.01 * R

    def process(x: Array, w: Array) -> Array:
        return np.asarray(np.sin(x @ F.T) + w * (1 + x))

    def measure(x: Array, v: Array) -> Array:
        return np.asarray(np.exp(0.5 * x @ H.T) + v * (1 + x[:, :2]))

    L = 10
    weights = rule(L)
    P = np.zeros((L, L))
    P[:4, :4], P[4:8, 4:8], P[8:, 8:] = belief.covariance, Q, R
    root = weights.spread * np.linalg.cholesky(P)
    centre = np.concatenate([belief.mean, np.zeros(6)])
    points = np.stack([centre, *(centre + root.T), *(centre - root.T)])
    w_mean = np.array([weights.mean] + [weights.other] * 20)
    w_cov = np.array([weights.covariance] + [weights.other] * 20)
    X = process(points[:, :4], points[:, 4:8])
    Z = measure(X, points[:, 8:])
    x, z = w_mean @ X, w_mean @ Z
    P_x = sum(w * np.outer(a - x, a - x) for w, a in zip(w_cov, X, strict=True))
    P_z = sum(w * np.outer(b - z, b - z) for w, b in zip(w_cov, Z, strict=True))
    P_xz = sum(w * np.outer(a - x, b - z) for w, a, b in zip(w_cov, X, Z, strict=True))
    K = P_xz @ np.linalg.inv(P_z)
    found = step_augmented(belief, process, Q, y, measure, R, rule)
    for a, b in (
        (found.predicted, z),
        (found.innovation_covariance, P_z),
        (found.belief.mean, x + K @ (y - z)),
        (found.belief.covariance, P_x - K @ P_z @ K.T),
    ):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-10)


def test_noise_enters_by_a_smaller_matrix_seed_2() -> None:
    """x' = F x + G w with one noise: the covariance has G q G^T, which is singular."""
    belief, F, _, _, _, _ = problem(2)
    G, q = np.array([[0.5], [1.0], [0.0], [0.0]]), np.array([[0.3]])
    found = predict_augmented(belief, lambda x, w: x @ F.T + w @ G.T, q)
    np.testing.assert_allclose(found.covariance, F @ belief.covariance @ F.T + 0.3 * G @ G.T, rtol=1e-12)


def test_a_factor_s_noise_multiplies_the_measurement_seed_3() -> None:
    """y = x (1 + v), x ~ N(3, .04), v ~ N(0, .01): mean 3, variance .04 + .01 (9 + .04), exact but for the last
    product, which the points do not see. Added noise knows nothing of the 9."""
    belief = Belief(np.array([3.0]), np.array([[0.04]]))
    update = update_augmented(belief, np.array([3.1]), lambda x, v: x * (1 + v), np.array([[0.01]]))
    rng = np.random.default_rng(3)
    x, v = rng.normal(3, 0.2, 400_000), rng.normal(0, 0.1, 400_000)
    assert update.innovation_covariance[0, 0] == pytest.approx(0.04 + 0.01 * 9, rel=1e-9)
    assert update.innovation_covariance[0, 0] == pytest.approx(np.var(x * (1 + v)), rel=0.01)


def test_one_draw_carries_the_odd_moments_that_two_lose() -> None:
    """x' = x + w^2, y = x': its mean moves by the variance of w, with either."""
    belief = Belief(np.array([0.0]), np.array([[1.0]]))
    Q, R = np.array([[0.5]]), np.array([[0.1]])
    prior = predict_augmented(belief, lambda x, w: x + w * w, Q)
    assert prior.mean[0] == pytest.approx(0.5)
    update = step_augmented(belief, lambda x, w: x + w * w, Q, np.array([0.5]), additive(lambda r: r), R)
    assert update.predicted[0] == pytest.approx(0.5)
    # variance of w^2 is 2 q^2 with the fourth moment that n + lambda = 3 matches
    assert update.innovation_covariance[0, 0] == pytest.approx(1 + 2 * 0.25 + 0.1)


def test_the_centre_has_its_own_weight_in_the_covariance() -> None:
    """The variance of x^2 + w, x ~ N(0, 1): 2, as n + lambda = 3 or beta = 2 has it, and w's own."""
    belief = Belief(np.array([0.0]), np.array([[1.0]]))
    for rule in (julier_weights, lambda n: scaled_weights(n, 1e-2, 2.0)):
        found = predict_augmented(belief, lambda x, w: x * x + w, np.array([[0.5]]), rule)
        assert found.mean[0] == pytest.approx(1.0, rel=1e-9)
        assert found.covariance[0, 0] == pytest.approx(2.5, rel=1e-3)
