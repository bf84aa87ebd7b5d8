"""The smooth variable structure filter against dense formulas: fixed, zero and variable layers, printed form."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import cubature, cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import Belief, FilterError, Method
from onboard.filters.kernels import variable_structure as kernel
from onboard.filters.smooth_variable_structure import LayerUpdate
from tests.support.filter_problems import identity, rows, spd, system

METHODS: dict[str, Method] = {m.name: m for m in (*svsf.METHODS, *cubature_smooth.METHODS)}
INF = float("inf")


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
def test_settings_are_refused_by_name(update: Callable[..., LayerUpdate], name: str) -> None:
    state = svsf.start(np.zeros(2), np.eye(2))
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        update(state, np.zeros(2), identity, np.eye(2))


@pytest.mark.parametrize("e", [0.4, -0.02, 3.0])
def test_a_switched_step_is_whole_however_small_the_innovation(e: float) -> None:
    """Beyond its layer there is no other width than the innovation's own."""
    gamma, residual = 0.5, 0.01
    made = np.zeros((3, 1))
    outside = np.zeros(1, bool)
    settings = kernel.Settings(kernel.SWITCHED_LAYER_TYPE, 3.0, gamma)
    memory = kernel.LayerMemory(np.array([residual]), *np.zeros((3, 1)))
    steps = kernel.SwitchingSteps(made[0], outside, made[1], made[2])
    S = R = np.array([[1e-6]])
    kernel.decide_into(settings, memory, np.array([e]), np.ones((1, 1)), S, R, np.zeros(0), steps)
    size = abs(e) + gamma * residual
    assert outside[0]
    assert made[1, 0] == pytest.approx(np.copysign(size, e))
    assert made[2, 0] == pytest.approx(min(size / abs(e), 1 + gamma))
