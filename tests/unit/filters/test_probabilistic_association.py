"""Probabilistic data association: the textbook's formulas, all joint events counted one by one, and what it is
for."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import Belief, FilterError, kalman, methods, particle
from onboard.filters import probabilistic_association as pda
from onboard.filters.discretisation import white_acceleration
from onboard.filters.gating import mean_bounds, normalised_squared

METHODS = methods()
H, ONE = np.eye(2, 4), np.eye(2)
F, Q = white_acceleration(1.0, 0.01, axes=2)


def position(rows: Array) -> Array:
    return rows[:, :2].copy()


def test_one_target_is_as_bar_shalom_daum_and_huang_have_it() -> None:
    """Their parametric filter, by its formulas: of three measurements, one of them outside the gate."""
    prior, R, density = Belief(np.zeros(4), np.diag([3.0, 3.0, 1.0, 1.0])), ONE, 0.01
    ys = np.array([[1.0, 0.5], [-2.0, 1.0], [40.0, 0.0]])
    S = H @ prior.covariance @ H.T + R
    e = np.exp(-0.5 * normalised_squared(ys[:2], S))
    b = 2 * np.pi * np.sqrt(np.linalg.det(S)) * density * (1 - 0.9 * 0.99) / 0.9
    beta, none = e / (b + e.sum()), b / (b + e.sum())
    K, together = prior.covariance @ H.T @ np.linalg.inv(S), beta @ ys[:2]
    spread = np.einsum("j,ja,jb->ab", beta, ys[:2], ys[:2]) - np.outer(together, together)
    P = prior.covariance - (1 - none) * K @ S @ K.T + K @ spread @ K.T
    for name in ("kalman", "extended", "unscented", "cubature", "square-root", "gauss-hermite", "ensemble"):
        method = METHODS[name]
        found = pda.update(method, [method.start(*prior)], ys, position, R, 0.9, density)
        after = method.belief(found.states[0])
        np.testing.assert_allclose(found.probabilities, [[*beta, 0, none]], rtol=1e-9)
        np.testing.assert_allclose(after.mean, K @ together, atol=1e-9)
        np.testing.assert_allclose(after.covariance, P, atol=1e-9)


def counted(weights: Array) -> Array:
    """Every joint event, one by one."""
    targets, count = weights.shape[0], weights.shape[1] - 1
    found = np.zeros(weights.shape)
    for event in product(range(count + 1), repeat=targets):
        taken = [j for j in event if j < count]
        if len(taken) == len(set(taken)):
            found[range(targets), event] += np.prod(weights[range(targets), event])
    return found / found.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("seed", range(5))
def test_joint_events_are_those_counted_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.exponential(3.0, (5, 5)) * (rng.random((5, 5)) < 0.6)
    weights[:, -1] = 0.1
    np.testing.assert_allclose(pda.marginals(weights), counted(weights), rtol=1e-12)


def test_a_hundred_targets_side_by_side_cost_no_more_than_each_with_its_neighbours() -> None:
    """Each may take its own measurement or the next one's: 2^100 events and more, each 1e9 times as likely as
    none."""
    weights = np.zeros((100, 102))
    for t in range(100):
        weights[t, [t, t + 1, 101]] = 1e9, 1e9, 1.0
    found = pda.marginals(weights)
    np.testing.assert_allclose(found.sum(axis=1), 1)
    assert np.all(found.sum(axis=0)[:101] < 1 + 1e-12)
    few = weights[:6, [*range(7), 101]]
    np.testing.assert_allclose(pda.marginals(few), counted(few), rtol=1e-9)
    with pytest.raises(FilterError, match="more than 100,000 ways"):
        pda.marginals(np.ones((12, 25)))


def flown(rng: np.random.Generator, steps: int = 30) -> tuple[Array, list[Array]]:
    """Two that cross at a small angle, seen in nine of ten steps among 2 false measurements in each 100 m
    square."""
    x = np.array([[0.0, -9.0, 10.0, 0.6], [0.0, 9.0, 10.0, -0.6]])
    truth, ys = [], []
    for k in range(steps):
        x = x @ F.T + (rng.multivariate_normal(np.zeros(4), Q, 2) if k else 0)
        truth.append(x)
        seen = (x[:, :2] + rng.normal(size=(2, 2)))[rng.random(2) < 0.9]
        false = x[:, :2].mean(axis=0) + rng.uniform(-50, 50, (rng.poisson(2.0), 2))
        ys.append(rng.permutation(np.concatenate([seen, false])))
    return np.array(truth), ys


def tracked(ys: list[Array], start: Array, joint: bool) -> list[Belief]:
    method, P = METHODS["kalman"], np.diag([1.0, 1.0, 0.25, 0.25])
    states: Any = [Belief(x, P) for x in start]
    for k, seen in enumerate(ys):
        states = [kalman.predict(state, F, Q) if k else state for state in states]
        groups = [states] if joint else [[state] for state in states]
        found = [pda.update(method, group, seen, position, ONE, 0.9, 2e-4) for group in groups]
        states = [state for one in found for state in one.states]
    return list(states)


def test_crossing_targets_keep_their_measurements_if_they_are_joint_seeds_0_to_59() -> None:
    """Each by itself takes the other's: 8 of 120 end elsewhere, and none of those that are joint."""
    lost, nees = {True: 0, False: 0}, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        truth, ys = flown(rng)
        start = truth[0] + rng.multivariate_normal(np.zeros(4), np.diag([1.0, 1.0, 0.25, 0.25]), 2)
        for joint in (True, False):
            for x, belief in zip(truth[-1], tracked(ys, start, joint), strict=True):
                gone = bool(np.hypot(*(belief.mean - x)[:2]) > 10.0)
                lost[joint] += gone
                if joint and not gone:
                    nees.append(float(normalised_squared(belief.mean - x, belief.covariance)))
    assert lost[True] == 0
    assert lost[False] > 4
    low, high = mean_bounds(4, len(nees))
    assert low < np.mean(nees) < high


def test_without_a_measurement_nothing_changes_and_an_angle_wraps() -> None:
    method, P = METHODS["unscented"], 0.01 * np.eye(1)
    state = method.start(np.array([3.12]), P)
    found = pda.update(method, [state], np.empty((0, 1)), lambda rows: rows.copy(), P, 0.9, 0.1)
    assert found.states == (state,)
    np.testing.assert_array_equal(found.probabilities, [[1.0]])
    seam = pda.update(method, [state], np.array([[-3.12]]), lambda r: r.copy(), P, 1.0, 1e-9, 0.99, (0,), (0,))
    assert method.belief(seam.states[0]).mean[0] == pytest.approx(np.pi, abs=1e-3)


def test_misuse_is_refused() -> None:
    method, y = METHODS["kalman"], np.zeros((1, 2))
    state, imm = Belief(np.zeros(4), np.eye(4)), METHODS["imm"]
    wrong: list[tuple[Any, str]] = [
        (lambda: pda.update(method, [state], y, position, ONE, 0.0, 1.0), "detection, clutter, gate"),
        (lambda: pda.update(method, [state], y, position, ONE, 0.9, 0.0), "detection, clutter, gate"),
        (lambda: pda.update(method, [state], y, position, ONE, 0.9, 1.0, 1.0), "detection, clutter, gate"),
        (lambda: pda.update(method, [state], y[0], position, ONE, 0.9, 1.0), "ys: must be"),
        (lambda: pda.update(method, [state], [[0.0, 0.0]], position, ONE, 0.9, 1.0), "ys: must be a NumPy array"),
        (lambda: pda.update(method, [], y, position, ONE, 0.9, 1.0), "ys: must be"),
        (lambda: pda.update(particle.METHOD, [particle.start(*state)], y, position, ONE, 0.9, 1.0), "Gaussian"),
        (lambda: pda.update(imm, [imm.start(*state)], y, position, ONE, 0.9, 1.0), "of one mode"),
    ]
    for call, message in wrong:
        with pytest.raises(FilterError, match=message):
            call()
