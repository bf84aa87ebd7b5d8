"""The smooth variable structure filters against dense formulas, and the misprints against the right forms."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from onboard.filters import cubature, cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError
from onboard.filters.smooth_variable_structure import SmoothUpdate
from onboard.geometry.rotations import Array

METHODS: dict[str, Method] = {m.name: m for m in (*svsf.METHODS, *cubature_smooth.METHODS)}
INF = float("inf")


def spd(rng: np.random.Generator, n: int) -> Array:
    A = rng.normal(0, 1, (n, n))
    return np.asarray(A @ A.T + 0.1 * np.eye(n))


def rows(M: Array) -> Callable[[Array], Array]:
    return lambda x: np.asarray(x @ M.T)


def identity(x: Array) -> Array:
    return x.copy()


class Dense:
    """The filters as the papers write them, with matrices and inverses; e_last kept between updates."""

    def __init__(self, x: Array, P: Array, gamma: float = 0.1) -> None:
        self.x, self.P, self.gamma, self.last = x, P, gamma, 0.0

    def predict(self, F: Array, Q: Array) -> None:
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q

    def look(self, y: Array, H: Array, R: Array, weighted: bool = True) -> tuple[Array, Array, Array, Array]:
        """e, S, A and G."""
        e, HPH = y - H @ self.x, H @ self.P @ H.T
        G = self.P @ H.T @ np.linalg.inv(HPH) if weighted else np.linalg.pinv(H)
        return e, HPH + R, np.abs(e) + self.gamma * np.abs(self.last), G

    def apply(self, y: Array, H: Array, R: Array, K: Array, step: Array) -> None:
        I_KH = np.eye(len(self.x)) - K @ H
        self.x, self.P = self.x + step, I_KH @ self.P @ I_KH.T + K @ R @ K.T
        self.last = y - H @ self.x

    def fixed(self, y: Array, H: Array, R: Array, psi: Array, weighted: bool = True) -> Array:
        e, _, A, G = self.look(y, H, R, weighted)
        s = A * np.where(np.abs(e) < psi, e / np.where(psi > 0, psi, 1), np.sign(e))
        self.apply(y, H, R, G @ np.diag(np.minimum(s / e, 1 + self.gamma)), G @ s)
        return e


def system(seed: int, n: int = 4, m: int = 2) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    rng = np.random.default_rng(seed)
    F, H = np.eye(n) + 0.1 * rng.normal(0, 1, (n, n)), rng.normal(0, 1, (m, n))
    return F, H, 0.1 * spd(rng, n), spd(rng, m), rng.normal(0, 3, n), spd(rng, n), rng.normal(0, 3, (15, m))


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("m", [1, 2, 4])
def test_a_fixed_layer_is_the_dense_formula_seed_1(m: int, weighted: bool) -> None:
    F, H, Q, R, x, P, seen = system(1, 4, m)
    dense, state = Dense(x, P), svsf.start(x, P)
    psi = np.linspace(0.5, 2.0, m)
    for y in seen:
        dense.predict(F, Q)
        e = dense.fixed(y, H, R, psi, weighted)
        state = svsf.predict(state, rows(F), Q)
        update = svsf.update(state, y, rows(H), R, layer=psi, weighted=weighted)
        state = update.belief
        np.testing.assert_array_equal(update.outside, np.abs(e) > psi)
    np.testing.assert_allclose(state.mean, dense.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(state.covariance, dense.P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(state.residual, dense.last, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["svsf-zero-layer", "first of csvsf-printed"])
@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_a_zero_layer_repeats_what_is_fully_measured_seed_2(name: str, offset: float) -> None:
    F, _, Q, _, x, P, _ = system(2, 6)
    rng = np.random.default_rng(2)
    R = spd(rng, 6)
    method = METHODS[name.removeprefix("first of ")]
    state = method.start(x, P)
    for y in offset + rng.normal(0, 3, (20, 6)):
        state = method.update(method.predict(state, rows(F), Q), y, identity, R, ()).belief
        held = state.first if name.startswith("first") else state
        np.testing.assert_allclose(held.mean, y, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(held.covariance, R, rtol=1e-10, atol=1e-10)


def test_a_step_moves_the_predicted_measurement_by_itself_seed_3() -> None:
    """H x+ = H x + s whatever the right inverse, so a zero layer meets the measurement of an unseen state too."""
    _, H, _, R, x, P, seen = system(3)
    for weighted in (True, False):
        after = svsf.update(svsf.start(x, P), seen[0], rows(H), R, sigmas=0.0, weighted=weighted).belief
        np.testing.assert_allclose(H @ after.mean, seen[0], atol=1e-12)


def test_only_the_weighted_inverse_moves_a_velocity_that_is_not_measured() -> None:
    mean, P = np.zeros(2), np.array([[1.0, 0.8], [0.8, 1.0]])
    arguments: Any = (svsf.start(mean, P), np.array([2.0]), lambda r: r[:, :1], np.array([[0.1]]))
    moved = svsf.update(*arguments, sigmas=0.0).belief.mean
    np.testing.assert_allclose(moved, [2.0, 1.6], atol=1e-12)
    still = svsf.update(*arguments, sigmas=0.0, weighted=False).belief.mean
    np.testing.assert_allclose(still, [2.0, 0.0], atol=1e-12)


def test_a_component_that_measures_nothing_moves_nothing_and_a_second_sensor_agrees() -> None:
    mean, P = np.zeros(2), np.diag([1.0, 2.0])
    H = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    after = svsf.update(svsf.start(mean, P), np.array([1.0, 5.0, 2.0, 2.0]), rows(H), np.eye(4), sigmas=0.0).belief
    np.testing.assert_allclose(after.mean, [1.0, 2.0], atol=1e-12)
    assert np.isfinite(after.covariance).all()


@pytest.mark.parametrize("m", [2, 4])
def test_within_the_limit_the_variable_layer_is_the_kalman_filter_seed_4(m: int) -> None:
    F, H, Q, R, x, P, seen = system(4, 4, m)
    state, belief = svsf.start(x, P), Belief(x, P)
    for y in seen:
        state = svsf.update_variable(svsf.predict(state, rows(F), Q), y, rows(H), R, sigmas=INF).belief
        belief = cubature.update(cubature.predict(belief, rows(F), Q), y, rows(H), R).belief
    np.testing.assert_allclose(state.mean, belief.mean, rtol=1e-9)
    np.testing.assert_allclose(state.covariance, belief.covariance, rtol=1e-9, atol=1e-9)


def test_the_optimal_layer_makes_the_switching_gain_the_kalman_gain_seed_5() -> None:
    """Gadsden & Habibi's very definition, for one component: K = A / psi, psi = S / (H P H^T) A."""
    _, H, _, R, x, P, seen = system(5, 3, 1)
    start = svsf.start(x, P)
    update = svsf.update_variable(start, seen[0], rows(H), R, sigmas=INF)
    again = svsf.update(start, seen[0], rows(H), R, layer=update.layer)
    np.testing.assert_allclose(again.belief.mean, update.belief.mean, rtol=1e-12)
    HPH = (H @ P @ H.T)[0, 0]
    assert update.layer[0] == pytest.approx((HPH + R[0, 0]) / HPH * abs(update.innovation[0]))
    second = svsf.update_variable(update.belief._replace(covariance=P), seen[1], rows(H), R, sigmas=INF)
    A = abs(second.innovation[0]) + 0.1 * abs(update.belief.residual[0])
    assert second.layer[0] == pytest.approx((HPH + R[0, 0]) / HPH * A)


def test_beyond_the_limit_it_is_the_fixed_layer_seed_6() -> None:
    _, H, _, R, x, P, seen = system(6)
    limit = np.array([1e-6, 1e-6])
    update = svsf.update_variable(svsf.start(x, P), seen[0], rows(H), R, limit=limit)
    fixed = svsf.update(svsf.start(x, P), seen[0], rows(H), R, layer=limit)
    assert update.outside.all()
    np.testing.assert_allclose(update.belief.mean, fixed.belief.mean, rtol=1e-12)
    np.testing.assert_allclose(update.belief.covariance, fixed.belief.covariance, rtol=1e-12)


def test_the_printed_form_is_the_dense_formula_seed_7() -> None:
    """Two filters of a fully measured state; eq 3.1 with the first one's Pzz = F R F^T + Q + R."""
    F, _, Q, _, x, P, _ = system(7, 3)
    rng = np.random.default_rng(7)
    R, H = spd(rng, 3), np.eye(3)
    method, state = METHODS["csvsf-printed"], METHODS["csvsf-printed"].start(x, P)
    first, second = Dense(x, P), Dense(x, P)
    for k, y in enumerate(rng.normal(0, 3, (15, 3))):
        first.predict(F, Q)
        second.predict(F, Q)
        e, S, _, _ = first.look(y, H, R)
        if k > 0:
            np.testing.assert_allclose(S, F @ R @ F.T + Q + R, rtol=1e-9)
        psi = np.diag(S) / np.diag(S - R) * np.abs(e)
        first.fixed(y, H, R, np.zeros(3))
        second.fixed(y, H, R, psi)
        state = method.update(method.predict(state, rows(F), Q), y, identity, R, ()).belief
    np.testing.assert_allclose(method.belief(state).mean, second.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(method.belief(state).covariance, second.P, rtol=1e-9, atol=1e-9)


def near(seed: int, m: int = 4) -> tuple[Array, Array, Array, Array, Array]:
    """A prior and a measurement that is close to what it predicts: H, R, mean, P, y."""
    _, H, _, R, x, P, _ = system(seed, 4, m)
    return H, R, x, P, H @ x + 0.3 * np.random.default_rng(seed).normal(0, 1, m)


@pytest.mark.parametrize(
    "update", [cubature_smooth.update, cubature_smooth.update_robust, cubature_smooth.update_adaptive]
)
@pytest.mark.parametrize("m", [1, 2, 4])
def test_within_the_layer_it_is_the_cubature_filter_seed_8(update: Callable[..., SmoothUpdate], m: int) -> None:
    H, R, x, P, y = near(8, m)
    found, expected = update(svsf.start(x, P), y, rows(H), R), cubature.update(Belief(x, P), y, rows(H), R)
    assert not found.outside.any()
    for a, b in zip((*svsf.believed(found.belief), *found[1:5]), (*expected.belief, *expected[1:]), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)


def test_a_component_outside_is_met_and_the_others_are_filtered_without_it_seed_9() -> None:
    """Dense: K of the others alone, then along G to where the far one is met."""
    H, R, x, P, y = near(9, 2)
    y[1] += 100
    found = cubature_smooth.update(svsf.start(x, P), y, rows(H), R)
    np.testing.assert_array_equal(found.outside, [False, True])
    h = H[:1]
    k = P @ h.T / (h @ P @ h.T + R[:1, :1])
    G = P @ H.T @ np.linalg.inv(H @ P @ H.T)
    step = k[:, 0] * (y[0] - h[0] @ x)
    mean = x + step + G[:, 1] * (y[1] - H[1] @ x - H[1] @ step)
    K = np.column_stack([k[:, 0] - G[:, 1] * (H[1] @ k[:, 0]), G[:, 1]])
    left = np.eye(4) - K @ H
    np.testing.assert_allclose(found.belief.mean, mean, rtol=1e-10)
    np.testing.assert_allclose(found.belief.covariance, left @ P @ left.T + K @ R @ K.T, rtol=1e-9, atol=1e-9)
    assert H[1] @ found.belief.mean == pytest.approx(y[1])


def test_the_robust_form_rejects_two_samples_and_follows_the_third_seed_10() -> None:
    H, R, x, P, y = near(10, 2)
    far = y + np.array([0.0, 1000.0])
    state = svsf.start(x, P)
    for k in range(2):
        alone = cubature.update(svsf.believed(state), y[:1], rows(H[:1]), R[:1, :1])
        update = cubature_smooth.update_robust(state, far, rows(H), R)
        np.testing.assert_array_equal(update.rejected, [False, True])
        np.testing.assert_allclose(update.belief.mean, alone.belief.mean, rtol=1e-10)
        np.testing.assert_allclose(update.belief.covariance, alone.belief.covariance, rtol=1e-10, atol=1e-12)
        np.testing.assert_array_equal(update.belief.lasted, [0, k + 1])
        state = update.belief
    followed = cubature_smooth.update_robust(state, far, rows(H), R)
    assert not followed.rejected.any()
    np.testing.assert_array_equal(followed.outside, [False, True])
    # by all of e and gamma of the last residual, which is as large
    assert H[1] @ followed.belief.mean - far[1] == pytest.approx(100, rel=0.01)


def test_one_sample_within_starts_the_count_anew_seed_11() -> None:
    H, R, x, P, y = near(11, 2)
    far = y + np.array([0.0, 1000.0])
    state = svsf.start(x, P)
    for seen, lasted in ((far, 1), (far, 2), (y, 0), (far, 1)):
        state = cubature_smooth.update_robust(state, seen, rows(H), R).belief
        assert state.lasted[1] == lasted
        state = state._replace(residual=np.zeros(2))  # or the last sample's would put this one outside too


def test_patience_of_one_is_the_recursive_form_seed_12() -> None:
    H, R, x, P, y = near(12)
    y[2] += 50
    a = cubature_smooth.update_robust(svsf.start(x, P), y, rows(H), R, patience=1)
    b = cubature_smooth.update(svsf.start(x, P), y, rows(H), R)
    np.testing.assert_array_equal(a.belief.mean, b.belief.mean)
    np.testing.assert_array_equal(a.belief.covariance, b.belief.covariance)


# ------------------------------------------------------------------------------------- the adaptive form


@pytest.mark.parametrize("m", [1, 2, 4])
def test_what_leans_to_one_side_widens_the_prior_seed_15(m: int) -> None:
    """Dense: P + G D G^T, G = P H^T (H P H^T)^-1, then the Kalman filter; D only of what leans too far. What leans
    less, but for longer, is doubted."""
    H, R, x, P, y = near(15, m)
    w = np.zeros(m)
    w[0] = 0.4
    slow = np.full(m, 0.3)
    state = svsf.start(x, P)._replace(residual=np.zeros(m), lasted=np.zeros(m), switching=w, leaning=slow)
    found = cubature_smooth.update_adaptive(state, y, rows(H), R)
    e, HPH = y - H @ x, H @ P @ H.T
    psi = 5 * np.sqrt(np.diag(HPH + R))
    w = 0.9 * w + 0.1 * e / psi
    np.testing.assert_allclose(found.belief.switching, w, rtol=1e-12)
    G = P @ H.T @ np.linalg.inv(HPH)
    wide = P + G @ np.diag(np.where(np.arange(m) == 0, (w * psi) ** 2, 0)) @ G.T
    slow = 0.98 * slow + 0.02 * e / psi
    doubted = np.where((np.arange(m) > 0) & (np.abs(slow) > 0.4 * np.sqrt(0.02 / 1.98)), (slow * psi) ** 2, 0)
    np.testing.assert_allclose(found.belief.doubt, G @ np.diag(doubted) @ G.T, rtol=1e-8, atol=1e-12)
    expected = cubature.update(Belief(x, wide), y, rows(H), R)
    np.testing.assert_allclose(found.belief.mean, expected.belief.mean, rtol=1e-9)
    np.testing.assert_allclose(found.belief.covariance, expected.belief.covariance, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.layer, 5 * np.sqrt(np.diag(expected.innovation_covariance)), rtol=1e-9)
    np.testing.assert_allclose(found.innovation_covariance, HPH + R, rtol=1e-9)


def test_a_second_sensor_of_one_quantity_widens_it_too() -> None:
    H = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    state = svsf.start(np.zeros(2), np.eye(2))
    zeros = np.zeros(3)
    leaning = state._replace(residual=zeros, lasted=zeros, switching=np.array([0.5, 0.5, 0.0]), leaning=zeros)
    update: Any = partial(cubature_smooth.update_adaptive, y=np.ones(3), measure=rows(H), R=np.eye(3))
    still, moved = (update(s).belief.mean for s in (state, leaning))
    assert moved[0] > still[0] + 0.1
    assert moved[1] == pytest.approx(still[1])


def test_an_outlier_is_rejected_and_a_drift_is_followed_seed_16() -> None:
    """A level that the model holds for constant: one sample 20 deviations off, then a deviation a step."""
    rng, Q, R = np.random.default_rng(16), np.array([[1e-4]]), np.eye(1)
    truth = np.concatenate([np.zeros(200), np.arange(100.0)])
    seen = truth + rng.normal(0, 1, 300)
    seen[150] += 20
    means = {}
    for update in (cubature_smooth.update_robust, cubature_smooth.update_adaptive):
        state, found = svsf.start(np.zeros(1), np.eye(1)), []
        for k, y in enumerate(seen):
            answer = update(svsf.predict(state, identity, Q), np.array([y]), identity, R)
            state = answer.belief
            assert answer.rejected[0] or k != 150
            found.append(state.mean[0])
        means[update.__name__] = np.array(found)
    robust, adaptive = means["update_robust"], means["update_adaptive"]
    np.testing.assert_array_equal(adaptive[:200], robust[:200])  # white innovations and one outlier: no difference
    lag = np.sqrt(np.mean((adaptive[-50:] - truth[-50:]) ** 2))
    assert lag < 1.6
    assert lag < 0.6 * np.sqrt(np.mean((robust[-50:] - truth[-50:]) ** 2))


def bend(x: Array) -> Array:
    return np.stack([np.sin(x[:, 0]) + x[:, 1] ** 2, x[:, 1] + 0.1 * x[:, 0] * x[:, 1]], axis=1)


def test_a_bent_measurement_is_the_cubature_filter_s_seed_13() -> None:
    """Innovation, its covariance and the update, where h is not linear: what is left of it counts as noise."""
    rng = np.random.default_rng(13)
    x, P, R = rng.normal(0, 1, 2), spd(rng, 2), spd(rng, 2)
    y = bend(x[None])[0] + 0.1
    found, expected = (
        cubature_smooth.update(svsf.start(x, P), y, bend, R),
        cubature.update(Belief(x, P), y, bend, R),
    )
    for a, b in zip((*svsf.believed(found.belief), *found[1:5]), (*expected.belief, *expected[1:]), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", METHODS)
def test_the_residual_of_an_angle_wraps(name: str) -> None:
    def seam(x: Array) -> Array:
        return np.asarray((x + np.pi) % (2 * np.pi) - np.pi)

    method = METHODS[name]
    update = method.update(
        method.start(np.array([np.pi - 0.01]), np.array([[0.04]])), np.array([0.02 - np.pi]), seam, np.eye(1), (0,)
    )
    state = getattr(update.belief, "second", update.belief)
    assert abs(state.residual[0]) < 0.05


@pytest.mark.parametrize(
    "update",
    [
        svsf.update,
        partial(svsf.update, layer=np.array([0.5, 1.0])),
        svsf.update_variable,
        cubature_smooth.update,
        cubature_smooth.update_robust,
        cubature_smooth.update_adaptive,
    ],
)
def test_a_batch_is_a_loop_in_all_that_is_answered_seed_14(update: Callable[..., SmoothUpdate]) -> None:
    rng = np.random.default_rng(14)
    _, H, _, _, _, _, _ = system(14)
    means, Ps, ys = (
        rng.normal(0, 1, (5, 4)),
        np.array([spd(rng, 4) for _ in range(5)]),
        rng.normal(0, 9, (3, 5, 2)),
    )
    R = 0.1 * spd(rng, 2)
    together = svsf.start(means, Ps)
    for y in ys:
        last = update(together, y, rows(H), R)
        together = last.belief
    for b in range(5):
        alone = svsf.start(means[b], Ps[b])
        for y in ys[:, b]:
            answer = update(alone, y, rows(H), R)
            alone = answer.belief
        for a, c in zip((*together, *last[1:]), (*alone, *answer[1:]), strict=True):
            np.testing.assert_allclose(a[b], c, rtol=1e-12, atol=1e-12)


def test_an_innovation_of_zero_is_a_measurement_too() -> None:
    """With a layer of zero, e = 0 and no residual, the covariance is that of having met the measurement."""
    after = svsf.update(svsf.start(np.zeros(2), np.eye(2)), np.zeros(2), identity, 0.25 * np.eye(2), sigmas=0.0)
    np.testing.assert_allclose(after.belief.covariance, 0.25 * np.eye(2), atol=1e-14)


def test_another_sensor_begins_with_no_residual() -> None:
    state = cubature_smooth.update(
        svsf.start(np.zeros(2), np.eye(2)), np.array([9.0, 9.0]), identity, np.eye(2)
    ).belief
    after = cubature_smooth.update(state, np.array([1.0]), lambda r: r[:, :1], np.eye(1)).belief
    assert after.residual.shape == after.lasted.shape == (1,)


# ------------------------------------------------------------------------------------- the misprints


def test_eq_2_3_3_as_printed_is_no_number_where_the_innovation_is_zero() -> None:
    e, psi = np.array([0.0, 1.0]), np.array([2.0, 2.0])
    with np.errstate(invalid="ignore", divide="ignore"):
        printed = (np.abs(e) * np.clip(e / psi, -1, 1)) / e
    assert np.isnan(printed[0])
    for name, method in METHODS.items():
        after = method.update(method.start(np.zeros(2), np.eye(2)), e, identity, np.eye(2), ())
        assert np.isfinite(method.belief(after.belief).mean).all(), name
        assert np.isfinite(method.belief(after.belief).covariance).all(), name


def test_eq_2_2_4_as_printed_cancels_a_million_metres_off() -> None:
    """E[X X^T] - x x^T loses the covariance to rounding; deviations from the mean keep it."""
    P = np.diag([1e-3, 1e-3])
    offsets = np.sqrt(2) * np.concatenate([np.sqrt(P), -np.sqrt(P)])
    X = 1e6 + offsets
    mean = X.mean(axis=0)
    printed = X.T @ X / 4 - np.outer(mean, mean)
    assert np.abs(printed - P).max() > 0.02 * 1e-3
    state = svsf.predict(svsf.start(np.array([1e6, 1e6]), P), identity, np.zeros((2, 2)))
    np.testing.assert_allclose(state.covariance, P, atol=1e-10)


def test_eq_2_2_12_as_printed_explodes_within_37_steps() -> None:
    """P + W Pzz W^T, where there is hardly any process noise: the covariance all but doubles at every step."""
    F, Q, R, P = np.array([[1.0, 0.01], [0.0, 1.0]]), 1e-6 * np.eye(2), np.diag([8e-4, 8e-4]), np.eye(2) * 32e-4
    printed, right = P, svsf.start(np.zeros(2), P)
    for _ in range(37):
        prior = F @ printed @ F.T + Q
        W = prior @ np.linalg.inv(prior + R)
        printed = prior + W @ (prior + R) @ W.T
        right = cubature_smooth.update(svsf.predict(right, rows(F), Q), np.zeros(2), identity, R).belief
    assert np.sqrt(printed[0, 0]) > 1e4  # metres, of a position measured to 3 cm
    assert np.sqrt(right.covariance[0, 0]) < 0.01


# ------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("update", "name"),
    [
        (partial(svsf.update, gamma=1.0), "gamma"),
        (partial(svsf.update, gamma=-0.1), "gamma"),
        (partial(svsf.update_variable, gamma=float("nan")), "gamma"),
        (partial(svsf.update, sigmas=-1.0), "sigmas"),
        (partial(cubature_smooth.update, kappa=float("nan")), "kappa"),
        (partial(svsf.update, layer=np.array([1.0, -1.0])), "layer"),
        (partial(svsf.update, layer=np.array([1.0])), "layer"),
        (partial(svsf.update, layer=np.array([1.0, np.nan])), "layer"),
        (partial(cubature_smooth.update_robust, patience=0), "patience"),
        (partial(cubature_smooth.update_adaptive, patience=0), "patience"),
        (partial(cubature_smooth.update_adaptive, fading=0.0), "fading"),
        (partial(cubature_smooth.update_adaptive, fading=float("nan")), "fading"),
    ],
)
def test_settings_are_refused_by_name(update: Callable[..., SmoothUpdate], name: str) -> None:
    state = svsf.start(np.zeros(2), np.eye(2))
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        update(state, np.zeros(2), identity, np.eye(2))


@pytest.mark.parametrize(
    ("R", "layer"),
    [(np.tile(np.eye(2), (2, 1, 1)), None), (np.eye(2), np.ones((2, 2))), (np.eye(2), np.ones((3, 1)))],
)
def test_a_batch_of_another_size_is_refused(R: Array, layer: Array | None) -> None:
    state = svsf.start(np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)))
    with pytest.raises(FilterError, match=r"\blayer\b"):
        svsf.update(state, np.zeros((3, 2)), identity, R, layer=layer)


def test_a_covariance_that_is_none_is_refused() -> None:
    with pytest.raises(NotPositiveDefiniteError, match="covariance"):
        svsf.update(svsf.start(np.zeros(2), -np.eye(2)), np.zeros(2), identity, np.eye(2))


def test_a_small_lasting_error_is_told_and_not_followed_seed_9() -> None:
    """A drift too small to be followed: the mean stays the robust form's, the covariance does not."""
    rng = np.random.default_rng(9)
    Q, R, drift = np.diag([1e-4]), np.diag([1.0]), 0.004
    truth, robust = 0.0, cubature_smooth.start(np.zeros(1), np.eye(1))
    adaptive, errors, told, kept = robust, [], [], []
    for k in range(3000):
        truth += drift + 0.01 * rng.standard_normal()
        y = np.array([truth + rng.standard_normal()])
        for name in ("robust", "adaptive"):
            state = robust if name == "robust" else adaptive
            state = cubature_smooth.predict(state, lambda rows: rows, Q)
            update = getattr(cubature_smooth, f"update_{name}")(state, y, lambda rows: rows, R)
            if name == "robust":
                robust = update.belief
            else:
                adaptive = update.belief
        if k > 500:
            errors.append(adaptive.mean[0] - truth)
            told.append(cubature_smooth.believed(adaptive).covariance[0, 0])
            kept.append(adaptive.covariance[0, 0])
    np.testing.assert_allclose(adaptive.mean, robust.mean, atol=0.05)
    squares = np.square(errors)
    assert np.mean(squares / kept) > 10.0
    assert np.mean(squares / told) < 4.0


def test_without_error_hardly_anything_is_doubted_seed_10() -> None:
    rng = np.random.default_rng(10)
    Q, R, truth = np.diag([1e-4]), np.diag([1.0]), 0.0
    state, doubted = cubature_smooth.start(np.zeros(1), np.eye(1)), []
    for _ in range(4000):
        truth += 0.01 * rng.standard_normal()
        state = cubature_smooth.predict(state, lambda rows: rows, Q)
        y = np.array([truth + rng.standard_normal()])
        state = cubature_smooth.update_adaptive(state, y, lambda rows: rows, R).belief
        doubted.append(state.doubt[0, 0] > 0.0)
    assert np.mean(doubted) < 0.08
