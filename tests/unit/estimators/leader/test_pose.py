"""Poses: what they measure, and what they do for a track."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose

from onboard.estimators.leader.assumptions import MARKER_HEADING_BIAS, MIN_VISIBLE_FRACTION
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import prediction, update
from onboard.estimators.leader.hypotheses.belief import make_filter
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.hypotheses.summary import LOG_SIZE, summarise
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.pose import measured_pose
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_euler, quaternion_from_matrix
from onboard.messages import Estimate, Lifecycle, RelativePose, TargetDetection
from studies.encounters.flights import Case, fly
from studies.encounters.scores import score
from tests.unit.estimators.leader.test_shape import IMAGE, SIGMA, detection, feature, leader, measured
from tests.unit.estimators.leader.test_shape_flown import flown, range_sigma_of_one_that_holds_the_truth

LEVEL = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
RANGE = 25.0


def rows(P: Any) -> Any:
    return tuple(map(tuple, np.asarray(P, dtype=float).tolist()))


def pose(
    *, range_: float = RANGE, sigma: float = 0.5, yaw: float | None = 0.6, turn: float = 0.05
) -> RelativePose:
    """Ahead of the camera, its heading this far to the right of the line of sight."""
    return RelativePose(
        r_CL_c=(range_, 0.0, 0.0),
        r_covariance=rows(np.diag([sigma**2, 0.01, 0.01])),
        q_cL=None if yaw is None else tuple(quaternion_from_euler(0.0, 0.0, yaw).tolist()),
        turn_covariance=None if yaw is None else rows(turn**2 * np.eye(3)),
    )


def image(of: RelativePose) -> TargetDetection:
    return replace(detection(feature("center", 0.0, 0.0)), pose=of)


def settings_of(**section: Any) -> Any:
    return make_filter(leader(**section))._settings


def cloud_after(*poses: RelativePose, **section: Any) -> Particles:
    """particles that starts with a pose, and takes others."""
    settings = settings_of(**section)
    particles = start(settings, measured(image(poses[0]), **section), LEVEL)
    for each in poses:
        particles, nis = update.update(settings, particles, measured(image(each), **section), LEVEL)
        assert nis < settings.gate
    return particles


def weight(particles: Particles, heading: float, within: float = 0.2) -> float:
    """Of the headings about an angle, not of those the other way round."""
    off = (particles.headings - heading + math.pi) % (2 * math.pi) - math.pi
    return float(np.exp(particles.log_weights)[np.abs(off) < within].sum())


# ------------------------------------------------------------------------------------ what it measures


def test_a_pose_alone_is_a_direction_with_a_range_of_its_own() -> None:
    m = measured(image(pose()))
    assert (m.has_wing, m.has_extent, m.is_metric, m.further) == (False, True, True, None)
    assert (m.span, m.span_sigma / m.span) == (pytest.approx(2.0 / RANGE), pytest.approx(0.5 / RANGE))
    assert m.pose.range_ == RANGE
    assert_allclose(m.pose.forward, (math.cos(0.6), math.sin(0.6), 0.0), atol=1e-12)


def test_a_pose_beside_a_wing_or_points_leaves_the_range_to_the_size() -> None:
    whole = measured(replace(IMAGE, pose=pose()))
    assert (whole.has_wing, whole.is_metric) == (True, False)
    assert whole.pose.range_ == RANGE
    assert measured(replace(IMAGE, pose=pose())).y.tolist() == measured(IMAGE).y.tolist()
    box = replace(detection(feature("center", 0.0, 0.0), feature("box", 0.0, 0.0), half=(0.04, 0.01)), pose=pose())
    assert (measured(box).is_metric, measured(box).further) == (True, None)


def test_a_rotation_alone_shows_no_range() -> None:
    m = measured(image(replace(pose(), r_CL_c=None, r_covariance=None)))
    assert (m.has_extent, m.is_metric, m.pose.range_) == (False, False, None)


def test_the_nose_s_azimuth_and_its_mirror_image_follow_the_camera_s_attitude() -> None:
    """A camera that looks to the east and 20 degrees down sees a heading 0.6 rad to the right of its axis."""
    R_nc = matrix_from_euler(0.0, math.radians(-20), math.pi / 2)
    camera = LEVEL._replace(R_cn=R_nc.T)
    R_nL = matrix_from_euler(0.2, -0.1, math.pi / 2 + 0.6)
    nose_c = R_nc.T @ R_nL
    q = tuple(np.asarray(quaternion_from_matrix(nose_c)).tolist())
    shown = measured_pose(replace(pose(), q_cL=q), 0.02, np.array([1.0, 0.0, 0.0])).heading(camera)
    assert shown is not None
    assert shown.at == pytest.approx(math.pi / 2 + 0.6)
    assert shown.mirrored == pytest.approx(math.pi / 2 - 0.6)
    assert shown.sigma == pytest.approx(math.hypot(0.05, MARKER_HEADING_BIAS), rel=0.01)


def test_a_nose_that_points_straight_up_has_no_azimuth() -> None:
    up = tuple(quaternion_from_euler(0.0, math.radians(85), 0.0).tolist())
    assert measured_pose(replace(pose(), q_cL=up), 0.02, np.array([1.0, 0.0, 0.0])).heading(LEVEL) is None


# ------------------------------------------------------------------------------------ what the particles becomes


@pytest.mark.parametrize("size_sigma", [0.02, 0.6])
def test_the_range_of_a_pose_has_its_bias_and_not_that_of_the_size(
    size_sigma: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Config, "pose_scale_sigma", 0.05)
    section = {"size_prior_sigma_m": size_sigma}
    settings, particles = settings_of(**section), cloud_after(*[pose(sigma=0.05)] * 20, **section)
    known = summarise(settings, particles)
    assert known.mean[:3] == pytest.approx((RANGE, 0.0, 0.0), abs=0.05)
    assert known.range_sigma() == pytest.approx(0.05, rel=0.05)
    assert math.sqrt(known.covariance[LOG_SIZE, LOG_SIZE]) == pytest.approx(size_sigma / 2.0, rel=0.1)


def test_a_rotation_resolves_the_nose_and_its_mirror_image_stays_possible() -> None:
    particles = cloud_after(*[pose()] * 8)
    assert particles.heading_observed
    assert weight(particles, 0.6) > 0.4
    assert weight(particles, -0.6) > 0.05
    assert weight(particles, 0.6 + math.pi) == weight(particles, -0.6 + math.pi) == 0.0


def test_without_a_rotation_every_nose_stays_as_likely() -> None:
    particles = cloud_after(*[pose(yaw=None)] * 3)
    assert not particles.heading_observed
    assert np.ptp(particles.log_weights) < 1e-6


def test_a_few_flipped_or_stray_rotations_do_not_move_the_nose() -> None:
    particles = cloud_after(*[pose()] * 15, pose(yaw=-0.6), pose(yaw=2.0), pose(yaw=-0.6))
    assert weight(particles, 0.6) > 0.7


def test_a_range_that_no_particle_expected_is_gated_and_the_cloud_stays() -> None:
    settings, particles = settings_of(), cloud_after(*[pose(sigma=0.1)] * 10)
    after, nis = update.update(settings, particles, measured(image(pose(range_=35.0, sigma=0.1))), LEVEL)
    assert nis > settings.gate
    assert after is particles
    # beside a wing, only the pose is left out
    half = 1.0 / RANGE
    wing = replace(
        IMAGE, center=(0.0, 0.0), left=(-half, 0.0), right=(half, 0.0), sigma=(SIGMA,) * 3, pose=pose(range_=90.0)
    )
    from_wing = start(settings, measured(wing), LEVEL)
    with_pose, nis = update.update(settings, from_wing, measured(wing), LEVEL)
    without, _ = update.update(settings, from_wing, measured(replace(wing, pose=None)), LEVEL)
    assert nis < settings.gate
    assert_allclose(with_pose.means, without.means)
    assert_allclose(with_pose.log_weights, without.log_weights)


def test_points_after_poses_leave_the_range_as_it_is_known_whatever_the_size() -> None:
    section = {"size_prior_sigma_m": 0.2}
    settings, particles = settings_of(**section), cloud_after(*[pose(sigma=0.05, yaw=None)] * 5, **section)
    assert particles.metric
    half = 1.1 / RANGE  # a wing of 2.2 m, which is one sigma larger
    wing = measured(
        replace(IMAGE, center=(0.0, 0.0), left=(-half, 0.0), right=(half, 0.0), sigma=(SIGMA,) * 3), **section
    )
    after = particles
    for _ in range(5):
        after, nis = update.update(settings, after, wing, LEVEL)
        assert nis < settings.gate
    assert (after.metric, after.edge_on_visibility) == (False, MIN_VISIBLE_FRACTION)
    assert 0.015 < summarise(settings, after).range_sigma() < 0.05
    again, _ = update.update(settings, after, measured(image(pose(sigma=0.05, yaw=None))), LEVEL)
    assert again.metric
    assert 0.015 < summarise(settings, again).range_sigma() < 0.05


# ----------------------------------------------------------------------------------------- whole flights


def newest(estimates: list[Estimate]) -> Estimate:
    assert estimates[-1].state is Lifecycle.TRACKING, estimates[-1].reason
    return estimates[-1]


def test_poses_alone_start_a_track_and_hold_it_whatever_the_size_seed_3() -> None:
    settings = "estimator.leader.size_prior_m=3.0", "estimator.leader.size_prior_sigma_m=1.0"
    encounter, estimates = flown("hover", 3, 8.0, "pose", *settings)
    last = newest(estimates)
    assert 0.02 < range_sigma_of_one_that_holds_the_truth(encounter, last) < 0.045


@pytest.mark.slow  # beside points that are always misplaced, in test_shape_flown.py
def test_poses_that_are_askew_and_flip_make_no_range_confidently_wrong_seed_16() -> None:
    found = score([fly(Case("behind", sees="pose"), 16)])
    assert found.wrong.percent < 1.5
    assert found.inside.percent > 80.0


def test_another_nose_moves_no_range_that_poses_show() -> None:
    settings, particles = settings_of()._replace(doubted_after=1e-9), cloud_after(pose(yaw=None))
    after = prediction.predict(settings, particles, 1e-6, np.zeros(3))
    assert np.abs(after.headings - particles.headings).max() > 1.0
    assert_allclose(after.means[:, :3], particles.means[:, :3], rtol=1e-4)
