"""What registration gives to the radar and to the tracks: the corrected attitude, jitter, and corrections."""

import numpy as np
import pytest

from onboard.estimators.traffic.registration import Registration
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_vector
from onboard.models.intruder import measurement
from onboard.units import NS_PER_S
from tests.support.registration import (
    CONFIG,
    RADAR,
    World,
    after_scans,
)


def test_jitter_is_the_effect_of_random_rotations_on_echoes_seed_12() -> None:
    registration, rng = after_scans(World(6, 12), 31), np.random.default_rng(12)
    R_rn = matrix_from_quaternion(quaternion_from_vector([0.3, -0.2, 1.0]))
    polar = np.array([[1000.0, 0.3, 0.1], [3000.0, -2.0, -0.8], [500.0, 3.0, 0.5]])
    sigma = registration.echo_jitter(polar, R_rn)
    positions, echoes = measurement.position(polar, np.zeros(3), R_rn), []
    for w in rng.multivariate_normal(np.zeros(3), registration._jitter, 4000):
        rows = np.pad(positions + np.cross(w, positions), ((0, 0), (0, 12)))
        echoes.append(measurement.echo(rows, np.zeros(3), np.zeros(3), R_rn))
    np.testing.assert_allclose(np.std(echoes, axis=0)[:, 1:], sigma[:, 1:], rtol=0.05)
    np.testing.assert_array_equal(sigma[:, 0], 0.0)
    assert np.all(np.isfinite(registration.echo_jitter(np.array([[100.0, 0.0, np.pi / 2]]), R_rn)))


def test_the_radar_s_attitude_is_corrected_by_the_rotation_seed_8() -> None:
    registration = after_scans(World(8, 8), 11)
    w = registration.rotation
    R_rn = matrix_from_quaternion(quaternion_from_vector([0.3, -0.2, 1.0]))
    d = np.array([1000.0, -500.0, 100.0])
    np.testing.assert_allclose(registration.corrected(R_rn) @ d, R_rn @ (d + np.cross(w, d)), atol=1.0)


def test_tracks_are_not_corrected_by_the_rotation_s_last_step_seed_11() -> None:
    """A correction is of the rotation in the tracks' positions; its step since the last scan is in none of
    them."""
    world, registration = World(8, 11), Registration(CONFIG)
    world.places[0] = [3000.0, 0.0, 0.0]
    world.reports[0] = world.report(0, 0)
    for number in range(20):
        registration.advance(number * NS_PER_S // 10)
        registration.update(number * NS_PER_S // 10, world.scan(number)[:1], RADAR)
    registration.advance(2 * NS_PER_S)
    before = registration.rotation.copy()
    correction = registration.update(2 * NS_PER_S, world.scan(20), RADAR)
    assert correction is not None  # the rotation about the first anchor's direction is new
    moved = registration.rotation - before
    assert correction.mean[0] == pytest.approx(moved[0], rel=0.2)
    assert abs(correction.mean[2]) < 0.9 * abs(moved[2])
