"""A range that is open: where the leader may be, and the one number that stands for all of it."""

from collections.abc import Sequence

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses.belief import make_filter
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.places import Place, places
from onboard.estimators.leader.hypotheses.summary import summarise
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import measure_wing

SETTINGS = LeaderModel(
    size=2.0, size_sigma=0.02, misalignment=(0.01, 0.01, 0.01), misalignment_time=60.0, own_velocity=0.1
)


def clumps(ranges: Sequence[float], weights: Sequence[float], count: int = 200) -> tuple[Array, Array]:
    """Means (K, 6) and weights (K,) of particles to the north, 3 % about each of the ranges. They sink at a
    tenth of the range each second."""
    rng = np.random.default_rng(1)
    r = np.concatenate([range_ * np.exp(0.03 * rng.normal(size=count)) for range_ in ranges])
    means = np.zeros((len(r), 6))
    means[:, 0], means[:, 5] = r, 0.1 * r
    return means, np.repeat(np.array(weights) / count, count)


def found(ranges: Sequence[float], weights: Sequence[float]) -> tuple[Place, ...]:
    means, w = clumps(ranges, weights)
    each = np.tile(0.01 * np.eye(6), (len(w), 1, 1))
    return places(w, means, each, lambda r: 0.0001 * np.diag([*(r * r), 0.0, 0.0, 0.0]))


def test_two_places_are_told_apart_with_their_probabilities() -> None:
    near, far = found([25.0, 12.0], [0.3, 0.7])
    assert (near.weight, far.weight) == (pytest.approx(0.7), pytest.approx(0.3))
    assert (near.mean[0], far.mean[0]) == (pytest.approx(12.0, rel=0.02), pytest.approx(25.0, rel=0.02))
    assert far.mean[5] == pytest.approx(2.5, rel=0.02)
    # the spread of the particles, their own variance, and the error that they share, a hundredth of the range
    assert far.covariance[0, 0] == pytest.approx((0.03 * 25.0) ** 2 + 0.01 + 0.25**2, rel=0.15)


def test_a_place_moves_with_its_leader_and_against_us() -> None:
    later = found([20.0], [1.0])[0].after(2.0, np.array([3.0, 0.0, 0.0]))
    assert later.mean[[0, 2]] == pytest.approx([17.0, 4.0], rel=0.02)
    assert later.covariance[1, 1] == pytest.approx(0.01 + 4.0 * 0.01)
    assert later.relative_to(np.array([0.0, 0.0, 1.0])).mean[5] == pytest.approx(1.0, rel=0.03)


def particles(ranges: Sequence[float], weights: Sequence[float]) -> Particles:
    motion, w = clumps(ranges, weights)
    means = np.zeros((len(w), model.N))
    means[:, :6] = motion
    P = np.tile(1e-4 * np.eye(model.N), (len(w), 1, 1))
    zeros = np.zeros(len(w))
    of_hypotheses = zeros, zeros, zeros, means, P, np.zeros((len(w), 3)), zeros, zeros, zeros
    return Particles(*of_hypotheses, np.log(w), 0)


def test_an_open_range_is_reported_about_its_geometric_mean_with_the_places() -> None:
    whole = summarise(SETTINGS, particles([10.0, 40.0], [0.5, 0.5]))
    assert whole.mean[0] == pytest.approx(20.0, rel=0.05)
    # second moments about the mean that is reported
    assert whole.covariance[0, 0] == pytest.approx((10.0**2 + 20.0**2) / 2.0, rel=0.05)
    assert whole.mean[5] == pytest.approx(2.0, rel=0.05)  # the velocity goes with the range
    assert [p.mean[0] for p in whole.places] == [pytest.approx(10.0, rel=0.02), pytest.approx(40.0, rel=0.02)]


def test_the_filter_says_what_is_open_and_where_relative_to_us() -> None:
    filter_ = make_filter(Config(size_prior_sigma_m=0.04))
    points = [(0.0, 0.0), (-0.02, 0.0), (0.02, 0.0)]
    v_F_n = np.array([2.0, 0.0, 0.0])
    pose = CameraPose(np.eye(3), np.zeros(3), v_F_n, np.zeros(3))
    state = filter_.start(measure_wing(points, [0.002] * 3), pose, None)
    reason, found_places, _ = filter_.open_question(state)
    assert reason == "heading not resolved: the range is uncertain"
    assert sum(place.weight for place in found_places) == pytest.approx(1.0)
    for place in found_places:  # a leader of which one image is known flies as we do, or hovers
        assert -2.0 < place.mean[3] < 1e-9
        assert place.covariance[3, 3] > 1.0
    assert 2.0 < found_places[0].mean[0] < 43.0
