"""The error of our own attitude, estimated from aircraft with echoes and reports: against truth drawn from the
model, and against reports that must not be believed."""

import numpy as np
import pytest
from msgspec import structs

from onboard.estimators.traffic.registration import AnchorEcho, Registration
from onboard.estimators.traffic.reports import Report
from onboard.units import NS_PER_S
from tests.support.registration import (
    AHEAD,
    CONFIG,
    MESSAGE,
    PRIOR_SIGMA,
    RADAR,
    World,
    after_scans,
    covariance_of,
)


def test_the_rotation_is_estimated_with_a_consistent_covariance_seeds_1_to_60() -> None:
    nees, errors = [], []
    for seed in range(1, 61):
        world = World(8, seed)
        registration = after_scans(world, 31)
        off = world.rotation - registration.rotation
        nees.append(off @ np.linalg.solve(covariance_of(registration), off))
        errors.append(off)
    assert np.sqrt(np.mean(np.square(errors))) < 0.25 * np.mean(PRIOR_SIGMA)
    assert 2.08 < np.mean(nees) < 4.13  # 60 times three degrees of freedom, 99.9 %


def test_an_error_of_our_own_position_is_not_taken_for_a_rotation_seeds_1_to_60() -> None:
    config = structs.replace(CONFIG, own_position_sigma_m=8.0)
    nees = []
    for seed in range(1, 61):
        world = World(6, seed, own_sigma=8.0, north=2000.0)
        registration = after_scans(world, 4, config)
        off = world.rotation - registration.rotation
        nees.append(off @ np.linalg.solve(registration._belief.covariance[:3, :3], off))
    assert 2.08 < np.mean(nees) < 4.13


def test_each_report_has_noise_of_its_own_seeds_1_to_60() -> None:
    """One anchor's reports: were their noise taken for a single error, they would not be averaged."""
    nees = []
    for seed in range(1, 61):
        world = World(1, seed, north=1500.0, white=8.0)
        registration = after_scans(world, 41)
        off = (world.rotation - registration.rotation)[1:]
        nees.append(off @ np.linalg.solve(registration._belief.covariance[1:3, 1:3], off))
    assert 1.24 < np.mean(nees) < 2.95  # 60 times two, 99.9 %


def test_the_residual_is_due_to_biases_and_our_own_position_by_hand() -> None:
    """Four anchors 1000 m north, without noise of radar and reports: the yaw that they leave open."""
    world = World(4, 1)
    world.places = np.tile([1000.0, 0.0, 0.0], (4, 1)) + RADAR
    registration = Registration(CONFIG)
    place, exact = world.places[0], 1e-4 * np.eye(3)
    reports = [
        Report(r.key, 0, np.r_[place, np.zeros(3)], 1e-4 * np.eye(6), r.bias_sigma, MESSAGE) for r in world.reports
    ]
    echoes = [AnchorEcho(k, place, place, exact, report) for k, report in enumerate(reports)]
    registration.advance(0)
    registration.advance(NS_PER_S)
    registration.update(NS_PER_S, echoes, RADAR)
    theirs = 3.0**2 - 1.0**2  # 3 m relative to us, of which 1 m is ours
    yaw = 1.0 / (1.0 / PRIOR_SIGMA[2] ** 2 + 1000.0**2 / (theirs / 4 + 1.0**2))
    by_them = yaw * (1.0 - yaw / PRIOR_SIGMA[2] ** 2)  # not by the rotation's own motion
    assert registration.residual.covariance[2, 2] == pytest.approx(by_them, rel=1e-3)
    moved = 1.0 - np.exp(-2.0 / CONFIG.own_attitude_time_s)  # within a second, about their direction
    along = PRIOR_SIGMA[0] ** 2 / (1.0 + moved) ** 2
    assert registration.residual.covariance[0, 0] == pytest.approx(along, rel=1e-3)
    # about their direction it changes as fast as our attitude, elsewhere nearly as slowly as their biases
    assert np.sort(registration.residual.times)[0] < 1.2 * CONFIG.own_attitude_time_s
    assert np.sort(registration.residual.times)[1] > 0.7 * CONFIG.report_bias_time_s / 2


def test_an_anchor_with_a_false_position_is_left_out_seed_5() -> None:
    honest, spoofed = World(6, 5), World(6, 5)
    spoofed.places = np.vstack([spoofed.places, [4000.0, 3000.0, -50.0]])
    spoofed.biases = np.vstack([spoofed.biases, [-90.0, 120.0, 0.0]])
    spoofed.reports.append(spoofed.report(6, 0))
    registration = after_scans(spoofed, 60)
    assert registration.residual.covariance == pytest.approx(
        after_scans(honest, 60).residual.covariance, rel=0.02, abs=1e-9
    )
    off = spoofed.rotation - registration.rotation
    assert off @ np.linalg.solve(covariance_of(registration), off) < 11.3  # 99 % of three


def test_without_anchors_the_rotation_decays_to_its_prior_seed_6() -> None:
    registration = after_scans(World(6, 6), 31)
    known = registration.rotation.copy()
    for number in range(31, 200):
        registration.advance(number * NS_PER_S // 10)
        assert registration.update(number * NS_PER_S // 10, [], RADAR) is None
    np.testing.assert_allclose(registration.residual.covariance, np.diag(PRIOR_SIGMA**2))
    np.testing.assert_allclose(registration.rotation, known * np.exp(-16.9 / 10.0), rtol=1e-6)
    np.testing.assert_array_equal(registration.echo_jitter(AHEAD, np.eye(3)), 0.0)
