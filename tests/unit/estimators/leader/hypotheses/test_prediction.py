"""What chance changes in particles; a file of its own because the mutants run it without the compiler."""

import math

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import prediction, view
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import measure_wing

HEADINGS = LeaderModel(
    size=2.0, size_sigma=0.04, misalignment=(0.007, 0.007, 0.024), misalignment_time=60.0, own_velocity=0.1
)
STILL = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
# 25 m to the north
IMAGE = measure_wing([(0.0, 0.0), (-0.035, 0.0), (0.035, 0.0)], [1.3e-3] * 3)


def wings(particles: Particles) -> Array:
    """What each particle expects of the wing in the image (K, 2), the right tip on the right."""
    camera = STILL.R_cn, STILL.r_FC_n, IMAGE.axes
    found = [
        view.expect(
            particles.means[k : k + 1],
            particles.covariances[k : k + 1],
            particles.headings[k : k + 1],
            np.ones(1),
            view.view_of(IMAGE.rows, camera, particles.course_locked[k : k + 1]),
        )[0][2:4]
        for k in range(len(particles.headings))
    ]
    return np.array(found)


def test_a_doubted_nose_shows_the_same_image() -> None:
    """A particle that takes another heading is nearer or farther by as much as its wing is seen less or more, and
    tilts so that the wing slopes as before; but for those that are seen almost along their wing."""
    settings = HEADINGS._replace(doubted_after=1e-9, tied=0.0)
    particles = start(settings, IMAGE, STILL)
    after = prediction.predict(settings, particles, 1e-6, np.zeros(3))
    changed = np.abs(after.headings - particles.headings) > 0.1
    assert 0.2 < changed.mean() < 0.95  # some would have to tilt as is not likely
    broad = np.abs(np.cos(particles.headings)) > 0.3
    both = changed & broad & (np.abs(np.cos(after.headings)) > 0.3)
    assert wings(after)[both] == pytest.approx(wings(particles)[both], rel=0.03, abs=2e-3)
    same = np.abs(after.headings - particles.headings) < 1e-4
    assert same.mean() > 0.05
    assert wings(after)[same] == pytest.approx(wings(particles)[same], abs=1e-4)


def test_only_a_slow_leader_begins_to_hover_and_one_that_is_doubted_meanwhile_stays_at_rest() -> None:
    settings = HEADINGS._replace(hovering=0.0, flies_for=1e-9, accelerating=0.0, doubted_after=1e-9, tied=0.0)
    particles = start(settings, IMAGE, STILL)
    particles.covariances[:, 3:6, 3:6] = 1e-4 * np.eye(3)
    fast = np.arange(len(particles.headings)) % 2 == 0
    particles.means[fast, 3], particles.means[~fast, 3] = 12.0, 0.01
    after = prediction.predict(settings, particles, 1e-6, np.array([0.0, 1e-6, 0.0]))
    assert (after.regimes[~fast] == model.HOVERING).all()
    assert (after.regimes[fast] != model.HOVERING).all()
    again = prediction.predict(settings._replace(hovers_for=1e9), after, 1e-6, np.array([0.0, 1e-6, 0.0]))
    assert np.abs(again.means[~fast, 3:6]).max() < 0.011
    assert np.abs(again.headings - after.headings).max() > 0.5


def test_intensities_keep_their_spread_over_time() -> None:
    settings = HEADINGS._replace(intensity=(0.8, 0.5, 0.2), intensity_time=2.0)
    particles = start(settings, IMAGE, STILL)
    first = particles.intensities
    for _ in range(100):
        particles = prediction.predict(settings, particles, 0.1, np.zeros(3))
    for each in (first, particles.intensities):
        assert each.std(axis=0) == pytest.approx(settings.intensity, rel=0.1)
    assert np.abs(np.corrcoef(first[:, 0], particles.intensities[:, 0])[0, 1]) < 0.2


def flying(speed: float, course_deg: float = 90.0, **settings: float) -> Particles:
    """Leaders that fly across the line of sight, or on another course, after a step that is long enough to decide
    on their headings."""
    supposed = HEADINGS._replace(hovering=0.0, flies_for=1e9, accelerating=0.0, undecided_for=1e-9, **settings)
    particles = start(supposed, IMAGE, STILL)
    particles.covariances[:, 3:6, 3:6] = 1e-4 * np.eye(3)
    course = math.radians(course_deg)
    particles.means[:, 3:6] = [speed * math.cos(course), speed * math.sin(course), 0.0]
    return prediction.predict(supposed, particles, 1e-3, np.zeros(3))


def asides(particles: Particles) -> Array:
    """How far each heading is off its course, rad."""
    off: Array = particles.headings - np.arctan2(particles.means[:, 4], particles.means[:, 3])
    return np.asarray(np.angle(np.exp(1j * off)))


def test_the_nose_of_a_fast_leader_is_tied_to_its_course_or_not_and_that_of_a_slow_one_is_undecided() -> None:
    fast, slow = flying(15.0, tied=0.6), flying(1.0, tied=0.6)
    course_locked = fast.course_locked == model.COURSE_LOCKED
    assert (
        0.45 < course_locked.mean() < 0.62
    )  # some would show less of their wing: the density of its slope is lower there
    assert (
        fast.course_locked[~course_locked] == model.FREE
    ).mean() > 0.8  # the others would tilt as is not likely
    assert (slow.course_locked == model.UNDECIDED).mean() > 0.98
    aside = asides(fast)
    assert aside[course_locked].mean() == pytest.approx(0.0, abs=0.3 * HEADINGS.nose_about_course)
    is_restless = fast.intensities[:, 2] > 0.0
    calm, restless = (
        aside[course_locked & (is_restless == one)].std() / HEADINGS.nose_about_course for one in (False, True)
    )
    assert 0.3 < calm < 0.8 < restless < 3.0
    assert np.abs(np.sin(aside[~course_locked])).mean() > 0.5


def test_how_far_a_tied_nose_is_off_its_course_lasts_and_is_forgotten_slowly() -> None:
    walk = math.radians(5.0)
    settings = HEADINGS._replace(tied_for=1e9, flies_for=1e9, nose_about_course=walk, slack_time=2.0)
    settings = settings._replace(intensity=(0.8, 0.5, 0.0))
    particles = start(settings, IMAGE, STILL)
    k, along = len(particles.headings), np.zeros_like(particles.means)
    along[:, 0], along[:, 3], along[:, model.LOG_SIZE] = 25.0, 15.0, math.log(2.0)
    particles = particles._replace(
        headings=np.full(k, 3.0 * walk), course_locked=np.full(k, model.COURSE_LOCKED), rates=np.full(k, 1.0)
    )
    means, spreads = [], []
    for _ in range(100):
        particles = prediction.predict(settings, particles._replace(means=along.copy()), 0.1, np.zeros(3))
        means.append(asides(particles).mean() / walk)
        spreads.append(asides(particles).std() / walk)
    assert means[4] == pytest.approx(3.0 * math.exp(-0.25), abs=0.15)
    assert means[-1] == pytest.approx(0.0, abs=0.15)
    assert spreads[4] == pytest.approx(math.sqrt(-math.expm1(-0.5)), abs=0.1)
    assert spreads[-1] == pytest.approx(1.0, abs=0.1)
    assert (particles.course_locked == model.COURSE_LOCKED).all()


@pytest.mark.parametrize(("course_deg", "slack_deg"), [(90.0, 0.01), (45.0, 5.0)])
def test_a_nose_that_becomes_tied_shows_the_same_image(course_deg: float, slack_deg: float) -> None:
    """The range goes with the heading, and the course with the range: they agree at the end."""
    after = flying(15.0, course_deg, tied=0.999, nose_about_course=math.radians(slack_deg))
    direction = after.means[:, :3] / np.linalg.norm(after.means[:, :3], axis=1)[:, None]
    lengths = model.visible(after.headings, direction) / np.linalg.norm(after.means[:, :3], axis=1)
    course_locked = after.course_locked == model.COURSE_LOCKED
    off = np.abs(lengths[course_locked] / 0.035 - 1.0)
    assert np.quantile(off, 0.99) < 0.03  # the most restless headings need more circles


def test_a_tied_nose_is_let_go_by_a_leader_that_slows_down() -> None:
    particles = flying(15.0, tied=0.999)
    particles.means[:, 3:6] = [0.0, 2.0, 0.0]
    after = prediction.predict(HEADINGS._replace(flies_for=1e9), particles, 1e-3, np.zeros(3))
    assert (after.course_locked == model.UNDECIDED).mean() > 0.98
