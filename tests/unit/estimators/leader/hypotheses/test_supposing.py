"""What a hypothesis may suppose, and at what cost: a tilt, a bank that lasts, a wobble, the same view again."""

import math

import numpy as np
import pytest

from onboard.estimators.leader.hypotheses import prediction, tilt, update
from onboard.estimators.leader.hypotheses.motion import BANK_ERROR, POSITION, TILT, WING_SCALE_ERROR
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import measure_wing
from onboard.geometry.rotations import matrix_from_euler
from tests.unit.estimators.leader.hypotheses.test_headings import SETTINGS, STILL, image

# Images correct each hypothesis, and say nothing of which one is right; none is drawn anew.
SILENT = SETTINGS._replace(evidence_rate=1e-12, fewest=SETTINGS.particles, resample=1e-9)
FAST = CameraPose(np.eye(3), np.zeros(3), np.array([9.0, 0.0, 0.0]), np.zeros(3))


def gained(before: Particles, after: Particles) -> np.ndarray:
    """Logarithms of how much more weight hypotheses have, the best one's as zero."""
    change = after.log_weights - before.log_weights
    return change - change.max()


def tilts(particles: Particles) -> np.ndarray:
    """Logarithms of how likely the tilts are, those that are improbable anyway left alike."""
    arrays = zip(particles.headings, particles.means, particles.covariances, particles.drags, strict=True)
    return np.array([tilt.plausible(*each, 0.0, SILENT.wind, SILENT.rolled) for each in arrays])


def test_what_an_image_makes_of_a_lean_counts_in_full_though_images_count_for_nothing() -> None:
    """A slope of 0.3 rad where there was none: each heading needs another tilt for it."""
    particles = start(SILENT, image(25.0, 0.6), STILL)
    after = update.update(SILENT, particles, image(25.0, 0.6, lean=0.1), STILL)[0]
    cost = tilts(after) - tilts(particles)
    assert np.ptp(cost) > 0.5
    np.testing.assert_allclose(gained(particles, after), cost - cost.max(), atol=1e-6)


def test_what_a_turn_of_the_nose_makes_of_a_lean_counts_in_full_and_not_only_the_way_back() -> None:
    """Of headings that turn and wander, of leaders that turn as well: what the one costs, the other gives back.
    When only the second counted, one that turned against its course gained weight with each step."""
    settings = SILENT._replace(doubted_after=1e12, undecided_for=1e12, still_for=0.4, nose_rate=3.0, hovering=0.0)
    particles = start(settings, image(25.0, 0.6, lean=0.1), FAST)
    particles.means[:, 7] += 2.0
    after = prediction.predict(settings, particles, 0.1, np.array([0.9, 0.0, 0.0]))
    assert (after.drags == particles.drags).all()  # none has taken another heading
    cost = tilts(after) - tilts(particles)
    assert np.ptp(cost) > 0.5
    np.testing.assert_allclose(gained(particles, after), cost - cost.max(), atol=1e-6)


def test_a_bank_that_lasts_costs_what_it_is_and_no_more() -> None:
    """Half of the hypotheses have supposed 8 degrees lately, which now is over: they get back what they paid."""
    particles = start(SILENT, image(25.0, 0.6), STILL)
    mean_bank_error = np.where(np.arange(len(particles.headings)) % 2, math.radians(8.0), 0.0)
    still = particles._replace(unseen=1e3)  # so long that only the present error of the bank counts
    plain = update.update(SILENT, still, image(25.0, 0.6), STILL)[0]
    relieved = update.update(SILENT, still._replace(mean_bank_error=mean_bank_error), image(25.0, 0.6), STILL)[0]
    back = relieved.log_weights - plain.log_weights
    assert back[1] - back[0] == pytest.approx(0.5 * (math.radians(8.0) / SILENT.rolled) ** 2, rel=1e-3)
    np.testing.assert_allclose(relieved.mean_bank_error, relieved.means[:, BANK_ERROR], atol=1e-6)


def test_the_first_range_is_as_uncertain_as_the_wobble_makes_the_wings_length() -> None:
    """Seen almost along itself: a heading that is 2 degrees off shows a third more of the wing, or less."""
    particles = start(SETTINGS, image(25.0, math.radians(85.0)), STILL)
    r, P = particles.means[:, POSITION], particles.covariances
    distance = np.linalg.norm(r, axis=1)
    along = np.einsum("ki,kij,kj->k", r, P[:, POSITION, POSITION], r) / distance**4
    assert (along >= P[:, WING_SCALE_ERROR, WING_SCALE_ERROR]).all()
    shared = np.einsum("ki,ki->k", r, P[:, POSITION, WING_SCALE_ERROR]) / distance**2
    np.testing.assert_allclose(shared, P[:, WING_SCALE_ERROR, WING_SCALE_ERROR], rtol=1e-9)
    assert np.sqrt(P[:, WING_SCALE_ERROR, WING_SCALE_ERROR]).max() > 0.3


@pytest.mark.parametrize("aspect_deg", [88.9, 90.0, 93.0])
def test_of_a_wing_that_points_at_us_from_above_the_noses_are_left_that_need_no_lean(aspect_deg: float) -> None:
    """It stands nearly upright in the image: one hypothesis was left, which tilted by 21 m/s^2."""
    R_cn = matrix_from_euler(0.0, math.radians(55.0), 0.0).T
    wing = np.array([-math.sin(math.radians(aspect_deg)), math.cos(math.radians(aspect_deg)), 0.0])
    ends = (R_cn @ (np.array([13.0, 0.0, -18.6]) + k * wing) for k in (0.0, -1.0, 1.0))
    seen = measure_wing([p[1:] / p[0] for p in ends], [1.0 / 554.0] * 3)
    particles = start(SETTINGS, seen, CameraPose(R_cn, np.zeros(3), np.zeros(3), np.zeros(3)))
    w, distances = np.exp(particles.log_weights), np.linalg.norm(particles.means[:, POSITION], axis=1)
    assert 1.0 / np.sum(w * w) > 25.0
    assert w @ np.linalg.norm(particles.means[:, TILT], axis=1) < 2.0
    assert w @ distances == pytest.approx(math.hypot(13.0, 18.6), rel=0.1)


def test_the_same_view_again_is_hardly_evidence_and_another_one_is() -> None:
    """At 3 m/s across, a line of 25 m turns by 0.12 rad a second: as much as makes an image of another view."""
    plain = SETTINGS._replace(fewest=SETTINGS.particles, resample=1e-9, drag=0.0)
    particles = start(plain, image(25.0, 0.3), STILL)._replace(startup_evidence=0.0, unseen=0.1)
    across = CameraPose(np.eye(3), np.zeros(3), np.array([0.0, 3.0, 0.0]), np.zeros(3))
    same, other = (
        float(np.ptp(gained(particles, update.update(plain, particles, image(25.0, 0.4), pose)[0])))
        for pose in (STILL, across)
    )
    assert other > 4.0 * same > 0.0
