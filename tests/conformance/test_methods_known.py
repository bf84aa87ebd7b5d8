"""What is known exactly, in every method: states without variance, measurements without noise, two states that are
one, modes that stand still. And batches, of which one member cannot be used."""

from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import kalman, methods
from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError
from tests.conformance.problems import cases

METHODS = methods()
every = pytest.mark.parametrize("method", cases(METHODS))
optimal = pytest.mark.parametrize("method", cases({k: m for k, m in METHODS.items() if "kalman" not in m.exempt}))
F = np.array([[1.0, 1.0], [0.0, 1.0]])
R = np.array([[0.25]])


def moves(rows: Array) -> Array:
    return np.asarray(rows @ F.T)


def first(rows: Array) -> Array:
    return rows[:, :1].copy()


def textbook(mean: Array, P: Array, Q: Array, R: Array, seen: Array, H: Array) -> Belief:
    for y in seen:
        mean, P = F @ mean, F @ P @ F.T + Q
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        mean, P = mean + K @ (y - H @ mean), (np.eye(2) - K @ H) @ P
    return Belief(mean, P)


def runs(method: Method, mean: Array, P: Array, Q: Array, R: Array, seen: Array) -> Belief:
    state = method.start(mean, P)
    for y in seen:
        state = method.predict(state, moves, Q)
        state = method.update(state, y, first, R).belief
    return method.belief(state)


SEEN = np.array([[1.2], [1.9], [3.3], [4.1], [4.8]])
KNOWN_SPEED = (np.array([0.0, 1.0]), np.diag([1.0, 0.0]), np.diag([0.1, 0.0]), R)
CLONED = (np.array([0.5, 0.5]), np.ones((2, 2)), np.zeros((2, 2)), R)
EXACT = (np.array([0.0, 1.0]), np.eye(2), np.diag([0.1, 0.1]), np.zeros((1, 1)))


@optimal
@pytest.mark.parametrize("case", [KNOWN_SPEED, CLONED], ids=["a state known exactly", "a cloned state"])
def test_a_singular_covariance_is_one(method: Method, case: Any) -> None:
    found, want = runs(method, *case, seen=SEEN), textbook(*case, seen=SEEN, H=np.eye(1, 2))
    np.testing.assert_allclose(found.mean, want.mean, atol=1e-9)
    np.testing.assert_allclose(found.covariance, want.covariance, atol=1e-9)


@optimal
def test_a_measurement_may_be_sharper_than_the_prior_by_any_number_of_decades(method: Method) -> None:
    """Of a variance of 1e12 a difference left -4.9e-4, or 0, for 1e-4. What has no digits is refused."""
    digits = 0.3 if method.name == "square-root-downdated" else 1e-6  # a downdate loses half of them by nature
    for decades in range(13):
        big, small = 10.0**decades, 1e-4
        P = np.array([[big, 0.09 * big**0.5], [0.09 * big**0.5, 0.01]])
        y, R_sharp = np.array([0.5]), np.array([[small]])
        try:
            found = method.update(method.start(np.zeros(2), P), y, first, R_sharp)
        except NotPositiveDefiniteError:
            continue
        want = 1.0 / (1.0 / big + 1.0 / small)
        variances = np.diag(method.belief(found.belief).covariance)
        np.testing.assert_allclose(variances, [want, 0.01 - 0.0081 * big / (big + small)], rtol=digits)


ROUNDS = {
    "square-root-downdated": "a downdate to zero fails by rounding, as the module says; other updates have none",
    "unscented-scaled-0.1": "weights of -99 lose two digits, and what is left may be below zero: it is refused",
}


@optimal
def test_a_measurement_may_be_exact(method: Method) -> None:
    """It was refused a call later, as a prior that is not positive definite."""
    if method.name in ROUNDS:
        pytest.skip(ROUNDS[method.name])
    found, want = runs(method, *EXACT, SEEN), textbook(*EXACT, SEEN, np.eye(1, 2))
    np.testing.assert_allclose(found.mean, want.mean, atol=1e-8)
    np.testing.assert_allclose(found.covariance, want.covariance, atol=1e-8)
    assert found.mean[0] == pytest.approx(4.8, abs=1e-12)


@every
def test_two_exact_measurements_of_one_thing_are_refused_by_name(method: Method) -> None:
    state = method.start(np.zeros(2), np.zeros((2, 2)))
    with pytest.raises(NotPositiveDefiniteError, match=r"\bR\b|downdate"):
        method.update(state, np.ones(1), first, np.zeros((1, 1)))


# ------------------------------------------------------------------------------------------ batches

COUNT, BAD = 50, 32


@every
@pytest.mark.parametrize("what", ["covariance", "process", "measure", "y"])
def test_a_batch_says_which_member_cannot_be_used(method: Method, what: str) -> None:
    mean, P = np.zeros((COUNT, 2)), np.tile(np.eye(2), (COUNT, 1, 1))
    y, member = np.zeros((COUNT, 1)), np.arange(COUNT)
    if what == "covariance":
        P[BAD] = [[1.0, 2.0], [2.0, 1.0]]
    if what == "y":
        y[BAD] = np.nan

    def spoiled(rows: Array, name: str) -> Array:
        bad = np.repeat(member, len(rows) // COUNT) == BAD
        return np.where((bad & (what == name))[:, None], np.nan, rows)

    def advance() -> None:
        state = method.predict(method.start(mean, P), lambda rows: spoiled(rows, "process"), np.eye(2))
        method.update(state, y, lambda rows: spoiled(rows, "measure")[:, :1].copy(), np.eye(1))

    with pytest.raises(FilterError, match=rf"^filter {BAD} of the batch: (covariance|process|measure|y|mean)"):
        advance()


def test_a_batch_of_batches_says_which() -> None:
    P = np.tile(np.eye(2), (3, 4, 1, 1))
    P[2, 1] = -np.eye(2)
    with pytest.raises(NotPositiveDefiniteError, match=r"^filter 2.1 of the batch: covariance"):
        kalman.predict(Belief(np.zeros((3, 4, 2)), P), F, np.eye(2))
