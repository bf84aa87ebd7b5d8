"""The tracks' filters: registration, errors shared with reports, and configured motion."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.traffic.batch import Radar
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.echoes import Echoes
from onboard.estimators.traffic.reports import Key, Report
from onboard.estimators.traffic.tracker import Tracker
from onboard.filters.belief import Belief
from onboard.models.intruder import motion
from onboard.units import NS_PER_S
from tests.support.registration import AHEAD, CONFIG, MESSAGE, RADAR, World, after_scans


def begin(tracker: Tracker, covariance: Array, key: Key | None = None, report: Report | None = None) -> None:
    """A track at the origin, after a second, with a report that counts as fused."""
    assert tracker._begin(Belief(np.zeros(15), covariance), key, NS_PER_S, "peer")
    tracker.tracks[-1] = tracker.tracks[-1]._replace(last_report=report)


def test_our_own_drift_correlates_a_track_s_position_with_the_bias_of_its_own_reports() -> None:
    """In a second 1/30 m^2 are added to r_OT_n and subtracted from the bias of the track that has reports."""
    tracker = Tracker(Config(own_position_sigma_m=1.0))
    tracker.advance(NS_PER_S)
    begin(tracker, np.eye(15), ("system", 1))
    bias = np.array([2.0, 3.0, 4.0])
    report = Report(("system", 2), NS_PER_S, np.zeros(6), np.eye(6), bias, MESSAGE)
    begin(tracker, np.eye(15), ("system", 2), report)
    tracker.advance(2 * NS_PER_S)
    first, second = tracker.batch.belief().covariance[:, motion.POSITION, motion.BIAS]
    np.testing.assert_allclose(first, 0.0, atol=1e-12)
    np.testing.assert_allclose(second, -np.diag([1 / 60, 1 / 90, 1 / 120]), rtol=1e-6, atol=1e-12)


def test_echoes_have_the_noise_of_the_radar_and_of_the_attitude_error_seed_13() -> None:
    tracker = Tracker(CONFIG)
    tracker.registration = after_scans(World(6, 13), 31)
    sigma = np.array([[10.0, 0.002, 0.004]])
    radar, echoes = tracker._registered(Radar(RADAR, np.eye(3)), Echoes(AHEAD, sigma))
    jitter = tracker.registration.echo_jitter(AHEAD, np.eye(3))
    assert np.all(jitter[0, 1:] > 1e-4)
    np.testing.assert_array_equal(echoes.polar, AHEAD)
    np.testing.assert_allclose(echoes.sigma, np.sqrt(sigma**2 + jitter**2))
    np.testing.assert_array_equal(radar.R_rn, tracker.registration.corrected(np.eye(3)))


def test_the_attitude_error_correlates_with_the_bias_of_anchors_only() -> None:
    world, tracker = World(4, 3), Tracker(CONFIG)
    tracker.advance(NS_PER_S)
    for number in range(1, 5):
        begin(tracker, np.eye(15), ("system", number), world.reports[number - 1])
    echoes = [e._replace(number=e.number + 1) for e in world.scan(0)[:2]]
    tracker.registration.advance(NS_PER_S)
    tracker.registration.update(NS_PER_S, echoes, RADAR)
    tracker.advance(2 * NS_PER_S)
    shared = tracker.batch.belief().covariance[:, motion.ATTITUDE_ERROR, motion.BIAS]
    assert np.abs(shared[:2]).max(axis=(1, 2)).min() > 1e-5
    np.testing.assert_allclose(shared[2:], 0.0, atol=1e-15)


def test_the_random_walk_of_the_velocity_is_as_large_after_three_seconds_as_gusts_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 0.5 m/s, with a time constant of 5 s: 2 (1 - exp(-3/5)) 0.25 = 0.2256 m^2/s^2, by hand."""
    monkeypatch.setattr(Config, "manoeuvre_acceleration_m_s2", 1e-6)
    tracker = Tracker(Config(filter="ekf"))
    tracker.advance(NS_PER_S)
    begin(tracker, np.zeros((15, 15)))
    for second in range(2, 5):
        tracker.advance(second * NS_PER_S)
    grown = np.diag(tracker.batch.belief().covariance[0])[motion.VELOCITY]
    np.testing.assert_allclose(grown, [0.2256, 0.2256, 0.0564], rtol=1e-3)
