"""The ensemble Kalman filter where it has few members, and so is not the Kalman filter of the conformance
suite."""

from itertools import pairwise

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import FilterError, ensemble

VARIABLES = 40


def lorenz(x: Array) -> Array:
    """Lorenz & Emanuel (1998), forcing 8."""
    return (np.roll(x, -1, axis=1) - np.roll(x, 2, axis=1)) * np.roll(x, 1, axis=1) - x + 8.0


def ahead(x: Array) -> Array:
    """After 0.05, six hours of weather, by one step of RK4."""
    k1 = lorenz(x)
    k2 = lorenz(x + 0.025 * k1)
    k3 = lorenz(x + 0.025 * k2)
    return x + 0.05 / 6 * (k1 + 2 * k2 + 2 * k3 + lorenz(x + 0.05 * k3))


def gaspari_cohn(distance: Array, half: float) -> Array:
    """Gaspari & Cohn (1999), eq 4.10: from 1 to 0 at twice `half`."""
    z = np.abs(distance) / half
    near = -(z**5) / 4 + z**4 / 2 + 5 * z**3 / 8 - 5 * z**2 / 3 + 1
    far = z**5 / 12 - z**4 / 2 + 5 * z**3 / 8 + 5 * z**2 / 3 - 5 * z + 4 - 2 / (3 * np.maximum(z, 1e-9))
    return np.where(z <= 1, near, np.where(z <= 2, far, 0.0))


def error(members: int, inflation: float, taper: Array | None, steps: int = 1000) -> float:
    """RMS over the last half of a record in which each of 40 variables is measured with an error of 1."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(1, VARIABLES))
    for _ in range(500):
        x = ahead(x)
    one, off = np.eye(VARIABLES), []
    state = ensemble.start(x[0] + rng.normal(size=VARIABLES), one, members, seed=1)
    for k in range(steps):
        x = ahead(x)
        state = ensemble.predict(state, ahead, 0 * one, inflation=inflation)
        both = None if taper is None else (taper, taper)
        y = x[0] + rng.normal(size=VARIABLES)
        state = ensemble.update(state, y, lambda rows: rows.copy(), one, taper=both).belief
        off += [np.sqrt(np.mean((state.mean - x[0]) ** 2))] if k >= steps // 2 else []
    return float(np.mean(off))


def test_forty_members_are_as_good_on_lorenz_s_weather_as_is_published_seed_1() -> None:
    """Sakov & Oke (2008), table 1: 0.18 of the deterministic form with 40 members and an inflation of 1.01."""
    assert error(40, 1.01, None) == pytest.approx(0.18, abs=0.02)


def test_ten_members_follow_it_with_a_taper_and_lose_it_without_seed_1() -> None:
    gap = np.abs(np.subtract.outer(np.arange(VARIABLES), np.arange(VARIABLES)))
    taper = gaspari_cohn(np.minimum(gap, VARIABLES - gap).astype(float), 5.0)
    assert error(10, 1.05, taper, 600) < 0.35
    assert error(10, 1.05, None, 600) > 2.0


def test_few_members_have_about_the_covariance_and_a_seed_draws_again() -> None:
    P = np.diag([4.0, 1.0, 0.25, 9.0])
    exact, few = (ensemble.start(np.zeros(4), P, members) for members in (6, 4))
    np.testing.assert_allclose(ensemble.belief(exact).covariance, P, atol=1e-12)
    assert np.linalg.matrix_rank(ensemble.belief(few).covariance) == 3
    np.testing.assert_allclose(few.deviations.mean(axis=0), 0, atol=1e-12)
    one, two, other = (ensemble.start(np.zeros(4), P, 6, seed) for seed in (1, 1, 2))
    moved = [ensemble.predict(state, lambda rows: rows * 1.1, P) for state in (one, two, other)]
    np.testing.assert_array_equal(moved[0].deviations, moved[1].deviations)
    assert np.abs(moved[0].deviations - moved[2].deviations).max() > 0.1
    states = [few]
    for _ in range(2):
        states.append(ensemble.predict(states[-1], lambda rows: rows * 1, P))
    first, second = (b.deviations - a.deviations for a, b in pairwise(states))
    assert np.abs(second - first).max() > 0.1


def test_one_member_and_a_taper_of_another_shape_are_refused() -> None:
    with pytest.raises(FilterError, match="members: must be at least 2, not 1"):
        ensemble.start(np.zeros(2), np.eye(2), 1)
    state, one = ensemble.start(np.zeros(2), np.eye(2)), np.eye(1)
    with pytest.raises(FilterError, match="taper_of_states"):
        ensemble.update(state, np.ones(1), lambda rows: rows[:, :1] * 1, one, taper=(np.eye(2), one))
