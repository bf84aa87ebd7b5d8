"""Properties that an unscented filter keeps on any problem, and what it must equal on linear ones.

On a linear problem the unscented transform is exact, so the filter is the Kalman filter. The oracles are textbook
formulas with explicit inverses, written here.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.arrays import Array
from onboard.estimators.oh_johnson.noise import process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief, NotPositiveDefiniteError, Update
from onboard.geometry.rotations import wrap_angle
from onboard.models import camera_angles, relative_motion
from studies.relative_motion.noise import HONEST, PAPER, Noise, initial_belief

SEED = st.integers(0, 2**32 - 1)
EXACT = 1e-9


def spd(rng: np.random.Generator, n: int) -> Array:
    """A covariance whose condition number stays below some 1e4."""
    A = rng.normal(0, 1, (n, n))
    return np.asarray(A @ A.T + 0.05 * np.eye(n))


def kalman_predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    return F @ x, F @ P @ F.T + Q


def kalman_update(x: Array, P: Array, y: Array, H: Array, R: Array) -> tuple[Array, Array]:
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return x + K @ (y - H @ x), (np.eye(len(x)) - K @ H) @ P


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
@given(SEED, st.integers(1, 9), st.integers(1, 4))
def test_equals_the_kalman_filter_on_linear_problems(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    F, H = np.eye(n) + 0.1 * rng.normal(0, 1, (n, n)), rng.normal(0, 1, (m, n))
    Q, R, weights = 0.01 * spd(rng, n), spd(rng, m), unscented.julier_weights(n)
    x, P = rng.normal(0, 3, n), spd(rng, n)
    belief = Belief(x, P)
    for _ in range(10):
        y = rng.normal(0, 3, m)
        belief = unscented.predict(belief, lambda rows: rows @ F.T, Q, weights)
        x, P = kalman_predict(x, P, F, Q)
        update = unscented.update(belief, y, lambda rows: rows @ H.T, R, weights)
        S = H @ P @ H.T + R
        assert update.predicted == pytest.approx(H @ x, rel=EXACT, abs=EXACT)
        assert update.innovation_covariance == pytest.approx(S, rel=EXACT, abs=EXACT)
        assert update.nis == pytest.approx(
            float((y - H @ x) @ np.linalg.inv(S) @ (y - H @ x)), rel=1e-8, abs=EXACT
        )
        belief, (x, P) = update.belief, kalman_update(x, P, y, H, R)
        assert belief.mean == pytest.approx(x, rel=EXACT, abs=EXACT)
        assert belief.covariance == pytest.approx(P, rel=EXACT, abs=EXACT)


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


def test_considering_no_state_is_the_ordinary_update_seed_2() -> None:
    rng = np.random.default_rng(2)
    belief, H, R = Belief(rng.normal(0, 1, 4), spd(rng, 4)), rng.normal(0, 1, (2, 4)), spd(rng, 2)
    y, weights = rng.normal(0, 1, 2), unscented.julier_weights(4)
    a = unscented.update(belief, y, lambda r: r @ H.T, R, weights)
    b = unscented.update(belief, y, lambda r: r @ H.T, R, weights, considered=())
    assert np.array_equal(a.belief.mean, b.belief.mean)
    assert np.array_equal(a.belief.covariance, b.belief.covariance)


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


def test_a_leader_straight_behind_is_updated_across_the_seam() -> None:
    """Azimuth predicted at +pi, measured just beyond: the innovation is small, and pulls to the right side."""
    mean = np.array([-30.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0])
    belief = Belief(mean, np.diag([1.0] * 6 + [0.01, 1.0, 1.0]))
    alpha = 2 * np.arctan(1.0 / 30.0)
    y = np.array([-np.pi + 0.05, np.pi, alpha])
    update = unscented.update(
        belief,
        y,
        lambda rows: camera_angles.measure(rows, np.eye(3), np.zeros(3)),
        np.diag([0.01, 0.01, 0.01]) ** 2,
        unscented.julier_weights(9),
        camera_angles.ANGULAR,
    )
    assert update.innovation[0] == pytest.approx(0.05, abs=1e-6)
    assert -1.6 < update.belief.mean[1] < -1.2  # 30 m behind, 0.05 rad past the tail: 1.5 m to the left


# --------------------------------------------------------------------------------------- vision problem


def vision_start(noise: Noise) -> Belief:
    angles = np.array([0.05, -0.03, 0.09])
    R = np.diag([0.002, 0.002, 0.0026]) ** 2
    return initial_belief(noise, angles, R, 2.667, 0.05334, np.eye(3), np.zeros(3))


def vision_run(noise: Noise, steps: int, seed: int) -> list[Belief]:
    """Predict and update on plausible and implausible measurements."""
    rng, weights = np.random.default_rng(seed), unscented.julier_weights(9)
    follower = relative_motion.FollowerMotion(
        np.array([20.0, 0.0, 0.0]),
        np.array([20.0, 0.05, 0.0]),
        np.array([0.0, 2.4, 0.0]),
        np.array([0.0, 2.4, 0.0]),
    )
    Q, R = process_noise(2.667, noise.walks) * 0.02, np.diag([0.002, 0.002, 0.0026]) ** 2
    beliefs = [vision_start(noise)]
    for k in range(steps):
        belief = unscented.predict(
            beliefs[-1], lambda rows: relative_motion.process(rows, 0.02, follower, 1.0), Q, weights
        )
        if k % 2:
            y = np.array([0.05, -0.03, 0.09]) + rng.normal(0, 0.003, 3)
            belief = unscented.update(
                belief,
                y,
                lambda rows: camera_angles.measure(rows, np.eye(3), np.zeros(3)),
                R,
                weights,
                camera_angles.ANGULAR,
                (relative_motion.SIZE,) if noise.consider_size else (),
            ).belief
        beliefs.append(belief)
    return beliefs


@pytest.mark.parametrize("noise", [PAPER, HONEST], ids=["paper", "honest"])
def test_the_covariance_stays_symmetric_and_positive_over_2000_steps_seed_6(noise: Noise) -> None:
    for belief in vision_run(noise, 2000, seed=6)[::10]:
        assert np.array_equal(belief.covariance, belief.covariance.T)
        sigma = np.sqrt(np.diag(belief.covariance))
        correlation = belief.covariance / np.outer(sigma, sigma)
        assert np.linalg.eigvalsh(correlation)[0] > 1e-9


def test_a_run_repeats_bit_for_bit_seed_6() -> None:
    first, second = vision_run(HONEST, 100, seed=6), vision_run(HONEST, 100, seed=6)
    assert all(np.array_equal(a.mean, b.mean) for a, b in zip(first, second, strict=True))
    assert all(np.array_equal(a.covariance, b.covariance) for a, b in zip(first, second, strict=True))


def test_inputs_are_not_written_to() -> None:
    belief = vision_start(HONEST)
    y, R, Q = np.array([0.05, -0.03, 0.09]), np.diag([0.002, 0.002, 0.0026]) ** 2, 1e-4 * np.eye(9)
    for array in (*belief, y, R, Q):
        array.flags.writeable = False
    weights = unscented.julier_weights(9)
    after = unscented.predict(belief, lambda rows: rows.copy(), Q, weights)
    for array in after:
        array.flags.writeable = False
    unscented.update(
        after,
        y,
        lambda rows: camera_angles.measure(rows, np.eye(3), np.zeros(3)),
        R,
        weights,
        camera_angles.ANGULAR,
        (relative_motion.SIZE,),
    )


# ------------------------------------------------------------------------------------------ failures


@pytest.mark.parametrize(
    "covariance",
    [np.diag([1.0, -1e-9]), np.array([[1.0, 2.0], [2.0, 1.0]]), np.full((2, 2), np.nan)],
    ids=["negative", "indefinite", "nan"],
)
def test_a_covariance_without_a_factor_is_refused(covariance: Array) -> None:
    belief, weights = Belief(np.zeros(2), covariance), unscented.julier_weights(2)
    with pytest.raises(NotPositiveDefiniteError):
        unscented.predict(belief, lambda rows: rows, np.eye(2), weights)
    with pytest.raises(NotPositiveDefiniteError):
        unscented.update(belief, np.zeros(2), lambda rows: rows, np.eye(2), weights)


def test_an_innovation_covariance_without_a_factor_is_refused() -> None:
    belief, weights = Belief(np.zeros(2), np.eye(2)), unscented.julier_weights(2)
    with pytest.raises(NotPositiveDefiniteError):
        unscented.update(belief, np.zeros(2), lambda rows: rows, -2.0 * np.eye(2), weights)
