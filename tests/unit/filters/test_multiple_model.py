"""The interacting multiple model against the textbook's loops, and in the cases where it must be one filter."""

from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import cubature_smooth, unscented
from onboard.filters import multiple_model as imm
from onboard.filters.belief import Belief, FilterError, Method
from onboard.filters.discretisation import white_acceleration

UKF = unscented.METHODS[0]
F = white_acceleration(0.5, axes=1).F
Q1, Q2 = white_acceleration(0.5, 0.01, axes=1).Q, white_acceleration(0.5, 4.0, axes=1).Q
H, R = np.array([[1.0, 0.0]]), np.array([[0.25]])
MEAN, P0 = np.array([1.0, -2.0]), np.diag([4.0, 1.0])
STAY = np.array([[0.9, 0.1], [0.2, 0.8]])
EQUAL = np.array([0.5, 0.5])


def process(rows: Array) -> Array:
    return np.asarray(rows @ F.T)


def measure(rows: Array) -> Array:
    return np.asarray(rows @ H.T)


def run(methods: tuple[Method, ...], seen: Array, noises: list[Array], transition: Array, first: Array) -> Any:
    state = imm.start(methods, MEAN, P0, first)
    update = None
    for y in seen:
        state = imm.predict(methods, state, [process] * len(methods), noises, transition)
        update = imm.update(methods, state, y, [measure] * len(methods), R)
        state = update.belief
    return state, update


def textbook(seen: Array, noises: list[Array], transition: Array, mu: Array) -> tuple[Array, Array, Array]:
    """Bar-Shalom, Li & Kirubarajan 2001, section 11.6.6, as written there."""
    r = len(noises)
    x, P = [MEAN] * r, [P0] * r
    for y in seen:
        c = [sum(transition[i, j] * mu[i] for i in range(r)) for j in range(r)]
        mixed_x, mixed_P = [], []
        for j in range(r):
            w = [transition[i, j] * mu[i] / c[j] for i in range(r)]
            m = sum(w[i] * x[i] for i in range(r))
            mixed_x.append(m)
            mixed_P.append(sum(w[i] * (P[i] + np.outer(x[i] - m, x[i] - m)) for i in range(r)))
        likelihood = np.zeros(r)
        for j in range(r):
            m, C = F @ mixed_x[j], F @ mixed_P[j] @ F.T + noises[j]
            S = H @ C @ H.T + R
            K, e = C @ H.T @ np.linalg.inv(S), y - H @ m
            x[j], P[j] = m + K @ e, C - K @ S @ K.T
            likelihood[j] = np.exp(-0.5 * e @ np.linalg.inv(S) @ e) / np.sqrt(np.linalg.det(2 * np.pi * S))
        mu = likelihood * c / (likelihood @ c)
    m = sum(mu[j] * x[j] for j in range(r))
    return mu, m, sum(mu[j] * (P[j] + np.outer(x[j] - m, x[j] - m)) for j in range(r))


def test_equals_the_textbook_seed_1() -> None:
    seen = np.random.default_rng(1).normal(0, 3, (25, 1))
    noises = [Q1, Q2, 10 * Q2]
    transition = np.array([[0.9, 0.05, 0.05], [0.1, 0.8, 0.1], [0.2, 0.2, 0.6]])
    first = np.array([0.6, 0.3, 0.1])
    methods = (UKF,) * 3
    state, update = run(methods, seen, noises, transition, first)
    mu, m, P = textbook(seen, noises, transition, first)
    belief = imm.belief(methods, state)
    np.testing.assert_allclose(update.predicted + update.innovation, seen[-1], rtol=1e-12)
    np.testing.assert_allclose(state.probabilities, mu, rtol=1e-9)
    np.testing.assert_allclose(belief.mean, m, rtol=1e-9)
    np.testing.assert_allclose(belief.covariance, P, rtol=1e-9)


def test_as_a_method_its_modes_have_their_factors_and_their_chain_seed_7() -> None:
    """Three, so that neither two modes nor the published method's equal factors stand for any number of them."""
    seen = np.random.default_rng(7).normal(0, 3, (10, 1))
    method = imm.as_method("three", (UKF,) * 3, (1.0, 4.0, 0.5), stay=0.8)
    state = method.start(MEAN, P0)
    for y in seen:
        one = method.update(method.predict(state, process, Q1), y, measure, R, ())
        state = one.belief
    chain = np.array([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])
    expected, update = run((UKF,) * 3, seen, [Q1, 4.0 * Q1, 0.5 * Q1], chain, np.full(3, 1 / 3))
    np.testing.assert_allclose(state.probabilities, expected.probabilities, rtol=1e-12)
    np.testing.assert_allclose(method.belief(state).mean, imm.belief((UKF,) * 3, expected).mean, rtol=1e-12)
    for ours, theirs in zip(one[1:5], update[1:5], strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
    assert one.misfits == ()  # and not the log-likelihood, which comes sixth


def test_the_model_that_moves_gains_probability_when_the_target_does_seed_4() -> None:
    rng = np.random.default_rng(4)
    t = 0.5 * np.arange(1, 60)
    track = np.where(t < 15, 1 - 2 * t, -29 + 3 * (t - 15) ** 2)  # a turn at 15 s
    state = imm.start((UKF, UKF), MEAN, P0, EQUAL)
    manoeuvre = []
    for y in (track + rng.normal(0, 0.5, len(t)))[:, None]:
        state = imm.predict((UKF, UKF), state, [process] * 2, [Q1, Q2], np.array([[0.95, 0.05], [0.05, 0.95]]))
        state = imm.update((UKF, UKF), state, y, [measure] * 2, R).belief
        manoeuvre.append(state.probabilities[1])
    assert np.mean(manoeuvre[15:28]) < 0.4
    assert np.mean(manoeuvre[34:]) > 0.9


def test_a_mode_that_nothing_leads_to_keeps_its_own_and_has_no_say_seed_5() -> None:
    seen = np.random.default_rng(5).normal(0, 3, (10, 1))
    state, _ = run((UKF, UKF), seen, [Q1, Q2], np.eye(2), np.array([1.0, 0.0]))
    single = UKF.start(MEAN, P0)
    for y in seen:
        single = UKF.update(UKF.predict(single, process, Q1), y, measure, R, ()).belief
    np.testing.assert_array_equal(state.probabilities, [1.0, 0.0])
    belief = imm.belief((UKF, UKF), state)
    np.testing.assert_allclose(belief.mean, single.mean, rtol=1e-12)
    np.testing.assert_allclose(belief.covariance, single.covariance, rtol=1e-12)
    other = UKF.start(MEAN, P0)
    for y in seen:
        other = UKF.update(UKF.predict(other, process, Q2), y, measure, R, ()).belief
    np.testing.assert_allclose(state.states[1].mean, other.mean, rtol=1e-12)
    np.testing.assert_allclose(state.states[1].covariance, other.covariance, rtol=1e-12)


def test_what_a_filter_carries_beside_its_belief_survives_the_mixing() -> None:
    robust = next(m for m in cubature_smooth.METHODS if m.name == "csvsf-robust")
    methods = (robust, UKF)
    state, _ = run(methods, np.array([[1.0], [500.0]]), [Q1, Q1], STAY, EQUAL)
    assert state.states[0].updates_outside == [1.0]
    state = imm.predict(methods, state, [process] * 2, [Q1, Q1], STAY)
    assert state.states[0].updates_outside == [1.0]


@pytest.mark.parametrize("side", [1, -1])
def test_angles_are_mixed_across_the_seam(side: int) -> None:
    """One mode predicts just before pi, the other just beyond."""
    methods = (UKF, UKF)
    state = imm.start(methods, np.array([np.pi]), np.array([[0.01]]), EQUAL)
    states = tuple(Belief(np.array([side * np.pi + d]), np.array([[0.01]])) for d in (-0.1, 0.1))
    state = state._replace(states=states)

    def seam(rows: Array) -> Array:
        return np.asarray((rows + np.pi) % (2 * np.pi) - np.pi)

    update = imm.update(methods, state, np.array([np.pi - 0.03]), [seam, seam], np.array([[0.01]]), (0,))
    assert update.innovation[0] == pytest.approx(-0.03, abs=1e-9)
    assert update.innovation_covariance[0, 0] == pytest.approx(0.02 + 0.01, abs=1e-9)


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"probabilities": np.array([0.5, 0.6])}, "probabilities"),
        ({"probabilities": np.array([-0.5, 1.5])}, "probabilities"),
        ({"probabilities": np.array([1.0])}, "probabilities"),
        ({"transition": np.eye(3)}, "transition"),
        ({"transition": np.array([[0.5, 0.6], [0.5, 0.5]])}, "transition"),
        ({"noises": [Q1]}, "noises"),
        ({"measures": [measure]}, "measures"),
        ({"transition": np.full((2, 2), np.nan)}, "transition"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(changed: dict[str, Any], name: str) -> None:
    given: dict[str, Any] = {"probabilities": EQUAL, "transition": STAY, "noises": [Q1, Q2]} | changed

    def step() -> None:
        state = imm.start((UKF, UKF), MEAN, P0, given["probabilities"])
        state = imm.predict((UKF, UKF), state, [process] * 2, given["noises"], given["transition"])
        imm.update((UKF, UKF), state, np.array([0.0]), given.get("measures", [measure] * 2), R)

    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        step()
