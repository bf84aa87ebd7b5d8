"""Reports and echoes of another aircraft, against Monte Carlo, numerical derivatives and numbers by hand."""

import math

import numpy as np
import pytest

from onboard.geometry.rotations import matrix_from_quaternion
from onboard.models.intruder import measurement
from tests.support.intruder import R_RN, RADAR, beliefs


def test_an_echo_is_where_the_aircraft_is() -> None:
    rows, _ = beliefs(50, 2)
    rows[:, 12:] = 0.0
    polar = measurement.echo(rows, np.zeros(50), RADAR, R_RN)
    np.testing.assert_allclose(measurement.position(polar, RADAR, R_RN), rows[:, :3], atol=1e-8)
    ahead = np.zeros((1, 15))
    ahead[0, :3] = 10.0, 10.0, -10.0  # north-east and above: right and up
    expected = math.sqrt(300.0), math.pi / 4, math.atan2(10.0, math.hypot(10.0, 10.0))
    np.testing.assert_allclose(measurement.echo(ahead, np.zeros(1), np.zeros(3), np.eye(3))[0], expected)


def test_the_attitude_error_rotates_all_echoes_even_overhead() -> None:
    rows, _ = beliefs(50, 2)
    rows[0, :3] = RADAR[0] + 5.0, RADAR[1], RADAR[2] - 1000.0  # nearly straight above: azimuth swings
    w = np.array([2e-3, -1e-3, 3e-3])
    rows[:, 12:] = w
    wrong = measurement.echo(rows, np.zeros(50), RADAR, R_RN)
    half = 0.5 * w
    believed = R_RN @ matrix_from_quaternion(
        np.array([1.0 - half @ half / 2, *half])
    )  # our attitude, with the error
    rows[:, 12:] = 0.0
    expected = measurement.echo(rows, np.zeros(50), RADAR, believed)
    np.testing.assert_allclose(wrong[:, 0], expected[:, 0], rtol=1e-12)
    off = np.remainder(wrong - expected + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off[:, 1:]).max() < 2e-5 * (1 + np.abs(np.tan(expected[:, 2])).max())


def test_the_expected_echo_is_the_model_s_tangent() -> None:
    means, covariances = beliefs(20, 3)
    polar, spread = measurement.expected_echo(means, covariances, 0.4, RADAR, R_RN)
    lag = np.full(20, 0.4)
    np.testing.assert_allclose(polar, measurement.echo(means, lag, RADAR, R_RN), atol=1e-12)
    H = np.zeros((20, 3, 15))
    for i in range(15):
        h = np.zeros(15)
        h[i] = 1e-3 if i < 12 else 1e-6
        up, down = (measurement.echo(means + s * h, lag, RADAR, R_RN) for s in (1, -1))
        H[:, :, i] = (up - down) / (2 * h[i])
    np.testing.assert_allclose(spread, H @ covariances @ H.transpose(0, 2, 1), rtol=1e-3, atol=1e-7)


def test_the_noise_of_a_position_by_monte_carlo_seed_4() -> None:
    rng, sigma = np.random.default_rng(4), np.array([[8.0, 0.01, 0.012]])
    polar = np.array([[1500.0, 2.0, -0.4]])
    draws = measurement.position(polar + sigma * rng.standard_normal((100_000, 3)), RADAR, R_RN)
    np.testing.assert_allclose(np.cov(draws.T), measurement.position_noise(polar, sigma, R_RN)[0], atol=6.0)


def test_straight_above_the_radar_nothing_is_infinite() -> None:
    means, covariances = beliefs(1, 5)
    means[:] = 0.0
    means[0, 2] = -500.0
    polar, spread = measurement.expected_echo(means, covariances, 0.0, np.zeros(3), np.eye(3))
    assert np.isfinite(polar).all()
    assert np.isfinite(spread).all()
    assert polar[0, 2] == pytest.approx(math.pi / 2, abs=2e-3)
