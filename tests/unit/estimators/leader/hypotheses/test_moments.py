"""The compiled arithmetic of the particles' summary is that of NumPy."""

import math

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.hypotheses import motion, summary
from onboard.estimators.leader.hypotheses.particles import occupied
from onboard.estimators.leader.hypotheses.summary import BANK_ERROR, HEADING, N, Summary, as_leader
from onboard.filters.belief import Belief
from onboard.models.relative_motion import A_LAT, A_LONG
from simlink.world.truth import path_accelerations


def spread(seed: int, n: int) -> Belief:
    """Any mean and covariance."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    return Belief(rng.normal(size=n), A @ A.T)


def test_the_moments_are_those_of_the_particles_seed1() -> None:
    rng = np.random.default_rng(1)
    k = 50
    headings, w = rng.uniform(-9.0, 9.0, k), rng.dirichlet(np.ones(k))
    means = rng.normal(size=(k, motion.N)) + 3.0
    P = rng.normal(size=(k, motion.N, motion.N))
    within = np.einsum("k,kij->ij", w, P)
    mean, S, log_ranges = summary.moments(headings, means, P, w, 0.5, math.pi)
    rows = np.zeros((k, N))
    rows[:, :9], rows[:, BANK_ERROR] = means[:, :9], means[:, motion.BANK_ERROR]
    rows[:, summary.LOG_SIZE] = means[:, motion.LOG_SIZE]
    rows[:, HEADING] = 0.5 + (headings - 0.5 + math.pi / 2) % math.pi - math.pi / 2
    np.testing.assert_allclose(mean, np.average(rows, axis=0, weights=w), rtol=1e-12, atol=1e-12)
    each = np.zeros((N, N))
    of_summary = [*range(9), summary.LOG_SIZE, BANK_ERROR]
    of_particle = [*range(9), motion.LOG_SIZE, motion.BANK_ERROR]
    each[np.ix_(of_summary, of_summary)] = within[np.ix_(of_particle, of_particle)]
    np.testing.assert_allclose(S, np.cov(rows.T, aweights=w, ddof=0) + each, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(log_ranges, np.log(np.linalg.norm(means[:, :3], axis=1)), rtol=1e-12)


def test_a_belief_after_a_while_is_that_of_the_summary_after_it_seed2() -> None:
    known = Summary(*spread(2, N))
    moved, v_F = np.array([1.0, -2.0, 0.5]), np.array([8.0, 1.0, 0.1])
    after = known.after(0.3, moved)
    at_once = Belief(*as_leader(known.mean, known.covariance, 0.3, moved, v_F))
    in_two = Belief(*as_leader(after.mean, after.covariance, 0.0, np.zeros(3), v_F))
    np.testing.assert_allclose(at_once.mean, in_two.mean, rtol=1e-12)
    np.testing.assert_allclose(at_once.covariance, in_two.covariance, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(at_once.covariance, at_once.covariance.T)


def test_accelerations_are_those_of_the_path_and_linearised_about_it_seed3() -> None:
    rng, v_F, moved, h = np.random.default_rng(3), np.array([1.0, 2.0, 0.0]), np.zeros(3), 1e-5
    mean, covariance = rng.normal(size=N), spread(3, N).covariance
    mean[motion.VELOCITY], mean[motion.ACCELERATION] = [5.0, -3.0, -2.0], [1.0, 2.0, -1.5]

    def published(change: Array) -> Array:
        return np.asarray(as_leader(mean + change, covariance, 0.2, moved, v_F)[0])

    found = published(np.zeros(N))
    v, a = mean[motion.VELOCITY] + 0.2 * mean[motion.ACCELERATION], mean[motion.ACCELERATION]
    across = path_accelerations(tuple(v.tolist()), tuple(a.tolist()))
    np.testing.assert_allclose(found[[A_LAT, A_LONG]], across, rtol=1e-12)
    np.testing.assert_allclose(found[summary.A_ALONG], v @ a / np.linalg.norm(v), rtol=1e-12)
    J = np.column_stack([(published(h * e) - published(-h * e)) / (2.0 * h) for e in np.eye(N)])
    expected = as_leader(mean, covariance, 0.2, moved, v_F)[1]
    np.testing.assert_allclose(J @ covariance @ J.T, expected, rtol=1e-6, atol=1e-8)


def ranges(log_range: Array) -> Array:
    """Means of particles to the north."""
    return np.column_stack([np.exp(log_range), np.zeros(len(log_range)), np.zeros(len(log_range))])


@pytest.mark.parametrize("seed", range(3))
def test_occupied_bins_are_those_that_have_enough_weight_seed_0_to_2(seed: int) -> None:
    rng = np.random.default_rng(seed)
    headings, log_range, w = rng.uniform(-9.0, 9.0, 700), rng.normal(3.0, 0.3, 700), rng.dirichlet(np.ones(700))
    bins = np.stack([np.floor(np.mod(headings, math.pi) / 0.1), np.floor(log_range / 0.05)])
    _, at = np.unique(bins, axis=1, return_inverse=True)
    expected = np.count_nonzero(np.bincount(at.ravel(), w) > 0.002)
    assert 100 < expected < 400
    assert occupied(headings, ranges(log_range), w, math.pi, 0.1, 0.05, 0.002) == expected


def test_a_range_that_is_no_number_occupies_one_bin() -> None:
    log_range, w = np.array([math.nan, math.nan, math.inf, 3.0]), np.full(4, 0.25)
    assert occupied(np.zeros(4), ranges(log_range), w, math.pi, 0.1, 0.05, 0.002) == 2
