"""Properties that an unscented filter keeps on any problem, and what it must equal on linear ones.

On a linear problem the unscented transform is exact, so the filter is the Kalman filter. The oracles are textbook
formulas with explicit inverses, written here.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.belief import Belief, Update
from onboard.geometry.rotations import wrap_angle

SEED = st.integers(0, 2**32 - 1)
EXACT = 1e-9


def spd(rng: np.random.Generator, n: int) -> Array:
    """A covariance whose condition number stays below some 1e4."""
    A = rng.normal(0, 1, (n, n))
    return np.asarray(A @ A.T + 0.05 * np.eye(n))


def schmidt_update(
    x: Array, P: Array, y: Array, H: Array, R: Array, considered: tuple[int, ...]
) -> tuple[Array, Array]:
    """Schmidt 1966: the Kalman gain with the considered rows set to zero, and Joseph's form, which holds for any
    gain."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    K[list(considered)] = 0.0
    L = np.eye(len(x)) - K @ H
    return x + K @ (y - H @ x), L @ P @ L.T + K @ R @ K.T


@settings(deadline=None)
@given(SEED, st.integers(2, 9), st.integers(1, 4), st.data())
def test_considered_states_follow_schmidt_and_never_move(seed: int, n: int, m: int, data: st.DataObject) -> None:
    chosen = data.draw(st.sets(st.integers(0, n - 1), min_size=1, max_size=n - 1))
    considered = tuple(sorted(chosen))
    rng = np.random.default_rng(seed)
    H, R, weights = rng.normal(0, 1, (m, n)), spd(rng, m), unscented.julier_weights(n)
    x, P = rng.normal(0, 3, n), spd(rng, n)
    belief, rows = Belief(x, P), list(considered)
    for _ in range(5):
        y = rng.normal(0, 3, m)
        after = unscented.update(belief, y, lambda r: r @ H.T, R, weights, considered=considered).belief
        x, P = schmidt_update(belief.mean, belief.covariance, y, H, R, considered)
        assert after.mean == pytest.approx(x, rel=EXACT, abs=EXACT)
        assert after.covariance == pytest.approx(P, rel=EXACT, abs=EXACT)
        assert np.array_equal(after.mean[rows], belief.mean[rows])
        assert np.array_equal(after.covariance[np.ix_(rows, rows)], belief.covariance[np.ix_(rows, rows)])
        assert np.linalg.eigvalsh(after.covariance)[0] > 0
        belief = after


# ------------------------------------------------------------------------------------------ angles wrap


@given(st.floats(-np.pi, np.pi), st.floats(-1.0, 1.0), st.floats(0.01, 0.5))
def test_an_angle_means_the_same_wherever_zero_is(turn: float, seen: float, sigma: float) -> None:
    """One state that is an angle, measured as it is: turning state and measurement together changes nothing."""
    weights, R = unscented.julier_weights(1), np.array([[0.04]])

    def update(zero: float) -> Update:
        belief = Belief(np.array([zero]), np.array([[sigma**2]]))
        return unscented.update(belief, wrap_angle([zero + seen]), wrap_angle, R, weights, angular=(0,))

    here, there = update(0.0), update(turn)
    assert there.innovation == pytest.approx(here.innovation, abs=1e-12)
    assert there.belief.mean - turn == pytest.approx(here.belief.mean, abs=1e-12)
    assert there.belief.covariance == pytest.approx(here.belief.covariance, abs=1e-12)
    assert here.belief.mean[0] == pytest.approx(seen * sigma**2 / (sigma**2 + 0.04), abs=1e-12)


# --------------------------------------------------------------------------------------- vision problem


# ------------------------------------------------------------------------------------------ failures


@given(st.integers(1, 30), st.floats(0.1, 2.0), st.floats(0.0, 3.0), st.floats(-0.9, 3.0))
def test_scaled_weights_have_their_spread_and_moments(n: int, alpha: float, beta: float, kappa: float) -> None:
    """Of one standard normal state: mean, variance, and van der Merwe's weight of the centre in covariances."""
    w = unscented.scaled_weights(n, alpha, beta, kappa)
    assert w.spread**2 == pytest.approx(alpha**2 * (n + kappa))
    assert w.mean + 2 * n * w.other == pytest.approx(1.0)
    assert 2 * w.other * w.spread**2 == pytest.approx(1.0)
    assert w.covariance - w.mean == pytest.approx(1.0 - alpha**2 + beta)
