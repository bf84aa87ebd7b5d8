"""A pose's heading as a measurement of particles."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import MIRRORED_POSE_PROBABILITY, STRAY_POSE_PROBABILITY
from onboard.estimators.leader.hypotheses import update
from onboard.estimators.leader.hypotheses.motion import BANK_ERROR, N


def particles(count: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(count, N, N))
    means = rng.normal(size=(count, N)) + np.r_[20.0, 5.0, -3.0, np.zeros(N - 3)]
    return means, roots @ roots.transpose(0, 2, 1) + np.eye(N)


def density(sigma: float, share: float) -> float:
    return share / (math.sqrt(2 * math.pi) * sigma) + STRAY_POSE_PROBABILITY / (2 * math.pi)


def test_a_nose_is_where_it_was_measured_or_at_the_mirror_image_or_anywhere_seed_2() -> None:
    headings = np.array([0.5, 2.5, 1.5])
    means, P = particles(3, 2)
    log_l = update.measure_heading(headings, means, P, 0.5, 2.5, 0.1)
    found = [
        density(0.1, 1 - MIRRORED_POSE_PROBABILITY - STRAY_POSE_PROBABILITY),
        density(0.1, MIRRORED_POSE_PROBABILITY),
        STRAY_POSE_PROBABILITY / (2 * math.pi),
    ]
    assert_allclose(np.exp(log_l), found, rtol=1e-9)
    assert headings.tolist() == [0.5, 2.5, 1.5]


def test_a_nose_is_the_same_a_turn_later() -> None:
    means, P = particles(2, 3)
    log_l = update.measure_heading(np.array([0.5, 0.5 + 6 * math.pi]), means, P, 0.5, 2.5, 0.1)
    assert log_l[0] == pytest.approx(log_l[1])


def test_a_particle_whose_nose_is_where_the_tail_is_turns_round_and_banks_to_the_other_side_seed_4() -> None:
    headings = np.array([0.5 - math.pi, 0.5])
    means, P = particles(2, 4)
    means[1], P[1] = means[0], P[0]
    before, before_P = means[0].copy(), P[0].copy()
    update.measure_heading(headings, means, P, 0.5, 2.5, 0.1)
    assert_allclose(headings, 0.5)
    sign = np.ones(N)
    sign[BANK_ERROR] = -1.0
    assert_allclose(means[0], sign * before)
    assert_allclose(P[0], sign[:, None] * before_P * sign)
    assert_allclose(P[1], before_P)
