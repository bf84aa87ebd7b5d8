"""The information form: sums of contributions are the Kalman filter's updates, and least squares without a
prior."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import Belief, FilterError, NotPositiveDefiniteError, information, kalman
from onboard.filters.cubature import weights
from onboard.filters.posterior_linearisation import regression
from tests.support.filter_problems import spd


def sensors(rng: np.random.Generator, count: int) -> list[tuple[Array, Array, Array]]:
    return [(rng.normal(size=2), rng.normal(size=(2, 4)), spd(rng, 2)) for _ in range(count)]


def test_a_hundred_sensors_are_a_hundred_updates_in_any_order_seed_1() -> None:
    rng = np.random.default_rng(1)
    belief, seen = Belief(rng.normal(size=4), spd(rng, 4)), sensors(rng, 100)
    want = belief
    for y, H, R in seen:
        want = kalman.update(want, y, H, R).belief
    parts = [information.from_belief(belief), *(information.contribution(*one) for one in seen)]
    together = information.contribution(*(np.stack(part) for part in zip(*seen, strict=True)))
    batch = information.Information(together.matrix.sum(0), together.vector.sum(0))
    for total in (information.fuse(*parts), information.fuse(*parts[::-1]), information.fuse(parts[0], batch)):
        found = information.to_belief(total)
        np.testing.assert_allclose(found.mean, want.mean, atol=1e-10)
        np.testing.assert_allclose(found.covariance, want.covariance, atol=1e-12)


def test_without_a_prior_it_is_weighted_least_squares_seed_2() -> None:
    rng = np.random.default_rng(2)
    seen = sensors(rng, 5)
    total = information.fuse(information.nothing(4), *(information.contribution(*one) for one in seen))
    root = [np.linalg.inv(np.linalg.cholesky(R)) for _, _, R in seen]
    A = np.concatenate([w @ H for w, (_, H, _) in zip(root, seen, strict=True)])
    b = np.concatenate([w @ y for w, (y, _, _) in zip(root, seen, strict=True)])
    np.testing.assert_allclose(information.to_belief(total).mean, np.linalg.lstsq(A, b)[0], rtol=1e-9)


def test_two_ranges_and_a_bearing_contribute_by_their_lines() -> None:
    """As `kalman.correct` with the same line."""
    belief, R = Belief(np.array([300.0, 400.0]), np.diag([25.0, 16.0])), np.diag([4.0, 1e-4])
    y = np.array([505.0, 0.93])

    def measure(rows: Array) -> Array:
        return np.stack([np.hypot(rows[:, 0], rows[:, 1]), np.arctan2(rows[:, 1], rows[:, 0])], 1)

    H, value, rest = regression(belief, measure, weights(2), y, (1,))
    part = information.contribution(y - value + H @ belief.mean, H, R + rest)
    found = information.to_belief(information.fuse(information.from_belief(belief), part))
    want = kalman.correct(belief, y, value, H, R + rest, angular=(1,)).belief
    np.testing.assert_allclose(found.mean, want.mean, rtol=1e-12)
    np.testing.assert_allclose(found.covariance, want.covariance, rtol=1e-9)


def test_what_is_open_or_exact_is_refused() -> None:
    H, one = np.array([[1.0, 0.0]]), np.eye(1)
    total = information.fuse(information.nothing(2), information.contribution(np.ones(1), H, one))
    with pytest.raises(NotPositiveDefiniteError, match="leaves a state, or a combination of states, open"):
        information.to_belief(total)
    both = information.contribution(np.ones(1), np.array([[1.0, 1.0]]), one)
    with pytest.raises(NotPositiveDefiniteError, match="open"):
        information.to_belief(information.fuse(both, both))
    with pytest.raises(NotPositiveDefiniteError, match="R: must be positive definite"):
        information.contribution(np.ones(1), H, 0 * one)
    with pytest.raises(NotPositiveDefiniteError, match="covariance: must be positive definite"):
        information.from_belief(Belief(np.zeros(2), np.diag([1.0, 0.0])))
    with pytest.raises(FilterError, match="shapes do not fit"):
        information.contribution(np.ones(2), H, one)
    with pytest.raises(FilterError, match="not finite"):
        information.contribution(np.array([np.nan]), H, one)
    with pytest.raises(FilterError, match="y: must be a NumPy array"):
        information.contribution(np.ma.masked_array([1.0], [True]), H, one)
