"""A leader seen from any side: the estimate holds the truth, or says that it does not know."""

import math

import numpy as np
import pytest

from onboard.estimators.leader.assumptions import STARTUP_TIME_S, LeaderModel
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import prediction, update
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.hypotheses.summary import LOG_SIZE, Summary, summarise
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement, measure_wing
from onboard.filters.belief import FilterError

SETTINGS = LeaderModel(
    size=2.0, size_sigma=0.04, misalignment=(0.007, 0.007, 0.024), misalignment_time=60.0, own_velocity=0.1
)
STILL = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))


def image(
    range_m: float,
    aspect: float,
    *,
    east: float = 0.0,
    lean: float = 0.0,
    seed: int = 1,
    swap: bool = False,
    middle: bool = False,
    noise_px: float = 1.0,
) -> Measurement:
    """A leader to the north, its heading `aspect` rad off the line of sight, banked by `lean`; 1 px of noise is
    configured."""
    level = math.cos(lean)
    wing = np.array([-math.sin(aspect) * level, math.cos(aspect) * level, math.sin(lean)])
    ends = [np.array([range_m, -east, 0.0]) + k * wing for k in (0.0, -1.0, 1.0)]
    points = np.array([p[1:] / p[0] for p in ends])
    points = points + np.random.default_rng(seed).normal(size=(3, 2)) * noise_px / 554.0
    if (points[1, 0] > points[2, 0]) != swap:
        points = points[[0, 2, 1]]  # detectors name wingtips by their side in the image
    return measure_wing(points.tolist(), [1.0 / 554.0] * 3, middle=middle)


def watched(
    aspect: float,
    seconds: float,
    *,
    sway: float = 0.0,
    lean: float = 0.0,
    swap: bool = False,
    turn: float = 0.0,
    gated: int = 6,
    middle: bool = False,
    noise_px: float = 1.0,
) -> Particles:
    """The particles after watching a leader 25 m away that hovers, while we sway from side to side by `sway` m.
    Its heading turns by `turn` rad from a third of the time to two thirds; at most `gated` images are not
    believed."""
    particles = start(SETTINGS, image(25.0, aspect, lean=lean), STILL)
    east, steps, left = 0.0, round(10 * seconds), gated
    for k in range(1, steps):
        new = sway * math.sin(2.0 * math.pi * k / 40.0)
        particles = prediction.predict(SETTINGS, particles, 0.1, np.array([0.0, new - east, 0.0]))
        east = new
        heading = aspect + turn * min(max(3.0 * k / steps - 1.0, 0.0), 1.0)
        swapped = swap and k % 2 == 1
        seen = image(25.0, heading, east=east, lean=lean, seed=k, swap=swapped, middle=middle, noise_px=noise_px)
        particles, nis = update.update(SETTINGS, particles, seen, STILL)
        left -= nis >= SETTINGS.gate
    assert left >= 0
    return particles


def off_by(summary: Summary) -> float:
    """The error of the range, in its standard deviations, of a leader 25 m away."""
    range_ = float(np.linalg.norm(summary.mean[:3]))
    return (range_ - 25.0) / (range_ * summary.range_sigma())


@pytest.mark.parametrize("aspect_deg", [20.0, 45.0, 65.0])
def test_a_leader_and_a_camera_at_rest_leave_the_range_open(aspect_deg: float) -> None:
    """Nothing but noise distinguishes the headings, and no weight drifts to one of them for long."""
    summary = summarise(SETTINGS, watched(math.radians(aspect_deg), 20.0))
    assert summary.range_sigma() > 0.1
    assert abs(off_by(summary)) < 4.0  # 3.1 +- 0.4 at 65 degrees: a broad wing needs no wobble to explain it


@pytest.mark.parametrize("aspect_deg", [50.0, 70.0])
@pytest.mark.parametrize("lean_deg", [-5.0, 5.0])
def test_a_steady_lean_against_the_wind_is_no_nose(aspect_deg: float, lean_deg: float) -> None:
    """A copter that hovers in wind tilts for as long as it blows. Its wing's slope must not be taken for a
    heading."""
    settled = summarise(SETTINGS, watched(math.radians(aspect_deg), 15.0, sway=2.0, lean=math.radians(lean_deg)))
    assert abs(off_by(settled)) < 2.0


@pytest.mark.parametrize(("turn_deg", "gated"), [(-70.0, 6), (70.0, 6), (110.0, 36)])
def test_a_nose_that_turns_and_stays_is_followed(turn_deg: float, gated: int) -> None:
    """Whether it turns out of the image plane or through it, the leader is not taken for one that flies away. Of a
    heading that turns through the image plane, images of up to four seconds are not believed."""
    summary = summarise(SETTINGS, watched(0.3, 18.0, sway=3.0, turn=math.radians(turn_deg), gated=gated))
    assert abs(off_by(summary)) < 2.0


def test_a_restarted_cloud_forgets_the_nose_but_a_gap_does_not() -> None:
    known = watched(0.3, 12.0, sway=3.0)
    startup_evidence = start(SETTINGS, image(25.0, 0.3), STILL)
    later = known
    for _ in range(8):
        later = prediction.predict(SETTINGS, later, 0.25, np.zeros(3))
    assert summarise(SETTINGS, later).range_sigma() < 0.6 * summarise(SETTINGS, startup_evidence).range_sigma()


def test_the_size_is_considered_not_estimated() -> None:
    summary = summarise(SETTINGS, watched(0.5, 5.0, sway=3.0))
    by_size = summary.covariance[:3, LOG_SIZE] / (0.02**2 * summary.mean[:3])
    assert math.exp(summary.mean[LOG_SIZE]) == pytest.approx(2.0)
    assert 0.3 < by_size[0] < 1.05  # as far as our own motion does not show the range
    assert summary.range_sigma() > 0.05


def test_a_cloud_without_numbers_is_an_error() -> None:
    particles = start(SETTINGS, image(25.0, 0.3), STILL)
    particles.means[:] = math.nan
    with pytest.raises(FilterError, match="lost their numbers"):
        update.update(SETTINGS, particles, image(25.0, 0.3), STILL)


@pytest.mark.parametrize("middle", [False, True])
def test_images_surprise_by_as_many_components_as_they_have(middle: bool) -> None:
    """The wing's middle is two more: with them, right images were as surprising as a leader that turns back."""
    assert 0.6 < watched(0.5, 6.0, sway=2.0, middle=middle).mean_nis < 1.15
    assert watched(0.5, 6.0, sway=2.0, middle=middle, noise_px=2.0, gated=60).mean_nis > 1.6


def test_evidence_counts_by_seconds_and_not_by_images() -> None:
    """Four times as long after the image before, four times as much."""
    settings = SETTINGS._replace(
        fewest=SETTINGS.particles, resample=1e-9, drag=0.0
    )  # what a tilt costs counts whole
    particles = prediction.predict(
        settings, start(settings, image(25.0, 0.3), STILL), 0.1, np.array([0.0, 0.3, 0.0])
    )

    def weight_of(unseen: float) -> float:
        after = update.update(settings, particles._replace(unseen=unseen), image(25.0, 0.3, east=0.3), STILL)[0]
        assert after.unseen == 0.0
        return float(np.ptp(after.log_weights - particles.log_weights))

    assert weight_of(0.4) == pytest.approx(4.0 * weight_of(0.1))
    assert weight_of(5.0) == pytest.approx(weight_of(1.0))  # no image counts more than once


@pytest.mark.parametrize(("near", "published"), [(20.0, 25.0), (10.0, 25.0**0.7 * 10.0**0.3)])
def test_a_resolved_range_is_the_median_and_an_open_one_the_geometric_mean(near: float, published: float) -> None:
    particles = start(SETTINGS, image(25.0, 0.0), STILL)
    k = len(particles.headings)
    ranges = np.where(np.arange(k) < 0.3 * k, near, 25.0)
    covariances = np.repeat(1e-4 * np.eye(model.N)[None], k, axis=0)
    means = np.zeros_like(particles.means)
    means[:, 0] = ranges
    known = particles._replace(means=means, covariances=covariances, log_weights=np.full(k, -math.log(k)))
    assert np.linalg.norm(summarise(SETTINGS, known).mean[:3]) == pytest.approx(published, rel=0.01)


def test_the_evidence_of_a_new_track_is_used_up_in_its_time() -> None:
    before = start(SETTINGS, image(25.0, 1.0), STILL)
    for seconds in (0.1, 1.0):
        after, _ = update.update(SETTINGS, before._replace(unseen=seconds), image(25.0, 1.0, seed=2), STILL)
        left = after.startup_evidence / before.startup_evidence
        assert left == pytest.approx(math.exp(-seconds / STARTUP_TIME_S))
