"""A leader seen from any side: the estimate holds the truth, or says that it does not know."""

import math

import numpy as np
import pytest

from onboard.estimators.leader import nose_mixture
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filter import Measurement
from onboard.estimators.leader.nose_cells import NARROW, Mixture, tidy
from onboard.estimators.leader.nose_summary import summarise
from onboard.estimators.leader.settings import NoseModel
from onboard.models import apparent_wing as model
from onboard.models.apparent_wing import LOG_SIZE, NOSE
from onboard.models.wing_line import from_points

SETTINGS = NoseModel(
    size=2.0, size_sigma=0.04, misalignment=(0.005, 0.005, 0.017), misalignment_time=60.0, own_velocity=0.1
)
STILL = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))


def image(range_m: float, aspect: float, *, east: float = 0.0, seed: int = 1) -> Measurement:
    """A leader to the north, its nose `aspect` rad off the line of sight, with 1 px of noise."""
    wing = np.array([-math.sin(aspect), math.cos(aspect), 0.0])
    ends = [np.array([range_m, -east, 0.0]) + k * wing for k in (0.0, -1.0, 1.0)]
    points = np.array([p[1:] / p[0] for p in ends])
    points = points + np.random.default_rng(seed).normal(size=(3, 2)) / 554.0
    if points[1, 0] > points[2, 0]:
        points = points[[0, 2, 1]]  # detectors name wingtips by their side in the image
    y, R, axes = from_points(points[None], np.full((1, 3), 1.0 / 554.0), 4)
    return Measurement(y[0], R[0], float(np.hypot(y[0, 2], y[0, 3])), math.sqrt(R[0, 2, 2]), axes[0])


def watched(range_m: float, aspect: float, seconds: float, *, sway: float = 0.0) -> Mixture:
    """The mixture after watching a hovering leader, while we sway from side to side by `sway` m."""
    mixture = nose_mixture.start(SETTINGS, image(range_m, aspect), STILL)
    east = 0.0
    for k in range(1, round(10 * seconds)):
        new = sway * math.sin(2.0 * math.pi * k / 40.0)
        mixture = nose_mixture.predict(SETTINGS, mixture, 0.1, np.array([0.0, new - east, 0.0]))
        east = new
        mixture, nis = nose_mixture.update(SETTINGS, mixture, image(range_m, aspect, east=east, seed=k), STILL)
        assert nis < SETTINGS.gate
    return mixture


def test_one_image_leaves_range_and_nose_open() -> None:
    mixture = nose_mixture.start(SETTINGS, image(25.0, math.radians(60.0)), STILL)
    summary = summarise(SETTINGS, mixture)
    assert len(mixture.log_weights) == SETTINGS.cells
    assert summary.range_sigma() > 0.3
    assert summary.direction_sigma() < 0.03


def test_a_leader_and_a_camera_at_rest_leave_the_range_uncertain() -> None:
    """How uncertain is known too little: docs/measurements.md has the limits."""
    assert summarise(SETTINGS, watched(25.0, math.radians(60.0), 8.0)).range_sigma() > 0.12


@pytest.mark.parametrize("aspect_deg", [0.0, 40.0, 60.0, 120.0])
def test_our_own_motion_resolves_the_range(aspect_deg: float) -> None:
    summary = summarise(SETTINGS, watched(25.0, math.radians(aspect_deg), 12.0, sway=3.0))
    assert summary.range_sigma() < 0.1
    assert np.linalg.norm(summary.mean[:3]) == pytest.approx(25.0, rel=3.0 * summary.range_sigma())


def test_the_size_is_considered_not_estimated() -> None:
    mixture = watched(25.0, math.radians(30.0), 5.0, sway=3.0)
    assert mixture.means[..., LOG_SIZE] == pytest.approx(math.log(2.0), abs=1e-3)


def test_a_split_cell_keeps_mean_and_variance() -> None:
    mixture = nose_mixture.start(SETTINGS, image(25.0, 0.3), STILL)
    first = Mixture(*(a[:1].copy() for a in mixture[:3]), np.zeros(1), mixture.axes)
    first.covariances[..., NOSE, NOSE] = math.radians(20.0) ** 2
    parts = tidy(SETTINGS, first)
    w = np.exp(parts.log_weights)
    mean = w @ parts.means[:, 0]
    off = parts.means[:, 0] - mean
    P = np.tensordot(w, parts.covariances[:, 0], 1) + (off * w[:, None]).T @ off
    assert len(w) == 3
    assert mean == pytest.approx(first.means[0, 0], abs=1e-12)
    assert pytest.approx(first.covariances[0, 0], abs=1e-12) == P
    assert parts.covariances[0, 0, NOSE, NOSE] == pytest.approx((NARROW * math.radians(20.0)) ** 2)


def test_cells_that_agree_are_merged_and_half_a_turn_is_no_difference() -> None:
    mixture = nose_mixture.start(SETTINGS, image(25.0, 0.3), STILL)
    twice = Mixture(*(np.concatenate([a[:1], a[:1]]) for a in mixture[:3]), np.log([0.5, 0.5]), mixture.axes)
    twice.means[1, :, NOSE] += math.pi
    merged = tidy(SETTINGS, twice)
    assert len(merged.log_weights) == 1
    assert merged.log_weights[0] == pytest.approx(0.0)
    assert merged.covariances == pytest.approx(mixture.covariances[:1])


def test_an_image_that_nothing_expected_changes_nothing() -> None:
    mixture = watched(25.0, 0.3, 3.0)
    after, nis = nose_mixture.update(SETTINGS, mixture, image(25.0, 0.3, east=15.0), STILL)
    assert nis > SETTINGS.gate
    assert after is mixture


def test_positions_of_cells_spread_along_the_line_of_sight() -> None:
    mixture = nose_mixture.start(SETTINGS, image(25.0, 0.0), STILL)
    ranges = np.linalg.norm(model.positions(mixture.means[:, 0], mixture.axes), axis=1)
    assert ranges.max() == pytest.approx(25.0, rel=0.05)
    assert ranges.min() < 5.0
