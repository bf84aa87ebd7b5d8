"""The camera's three angles, compared with numbers computed by hand."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler
from onboard.models import camera_angles

NOWHERE = np.zeros(3)
F_PX = 554.256


def angles(r_c: tuple[float, float, float], size: float = 2.0) -> Array:
    row = np.zeros((1, 9))
    row[0, :3], row[0, 6] = r_c, size
    return camera_angles.measure(row, np.eye(3), NOWHERE)[0]


def test_azimuth_is_positive_to_the_right_and_elevation_below_the_axis() -> None:
    assert angles((10.0, 10.0, 0.0))[0] == pytest.approx(np.pi / 4, rel=1e-15)
    assert angles((10.0, 0.0, 10.0))[1] == pytest.approx(np.pi / 4, rel=1e-15)
    assert angles((10.0, -1.0, -2.0))[:2] == pytest.approx([-0.09966865249116204, -0.19739555984988078], rel=1e-14)


def test_subtended_angle_is_of_the_slant_range() -> None:
    assert angles((2.0, 3.0, 6.0), size=14.0)[2] == pytest.approx(np.pi / 2, rel=1e-15)  # range 7, tan = 1


def test_the_camera_may_sit_off_centre_and_turned() -> None:
    """Camera 1 m ahead of the centre, looking east (yaw 90); the leader 10 m to its front is east of it."""
    R_cn = matrix_from_euler(0.0, 0.0, np.pi / 2).T
    row = np.zeros((1, 9))
    row[0, :3], row[0, 6] = (1.0, 10.0, 0.0), 2.0
    measured = camera_angles.measure(row, R_cn, np.array([1.0, 0.0, 0.0]))[0]
    assert measured == pytest.approx([0.0, 0.0, 2 * np.arctan(0.1)], abs=1e-15)


def test_angles_from_points_is_eq_18() -> None:
    points = np.array([[0.3, -0.4], [0.0, 0.0], [0.6, 0.8]])  # span 1, D = sqrt(1 + .25)
    expected = [np.arctan(0.3), np.arctan(-0.4), 2 * np.arctan(1.0 / (2 * 1.25**0.5))]
    assert camera_angles.angles_from_points(points) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(("yaw_deg", "percent"), [(30, 15), (45, 41), (60, 100)])
def test_a_yawed_leader_seems_farther_away_by(yaw_deg: float, percent: float) -> None:
    """Eq 17 takes the wing to be parallel to the image plane."""
    yaw, r = np.radians(yaw_deg), np.array([300.0, 0.0, 0.0])
    half = np.array([np.sin(yaw), np.cos(yaw), 0.0])
    points = np.array([(p / p[0])[1:] for p in (r, r - half, r + half)])
    alpha = camera_angles.angles_from_points(points)[2]
    assert 100 * (1.0 / np.tan(alpha / 2) / 300.0 - 1) == pytest.approx(percent, abs=0.7)


@pytest.mark.parametrize("seed", range(4))
def test_position_from_angles_inverts_measure_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R_cn = matrix_from_euler(*rng.normal(0, 1, 3)).T
    r_FC_n = rng.normal(0, 1, 3)
    r_c = np.column_stack([rng.uniform(5, 100, 20), rng.normal(0, 20, 20), rng.normal(0, 20, 20)])
    rows = np.zeros((20, 9))
    rows[:, :3], rows[:, 6] = r_c @ R_cn + r_FC_n, rng.uniform(0.5, 5, 20)
    measured = camera_angles.measure(rows, R_cn, r_FC_n)
    again = camera_angles.position_from_angles(measured, rows[:, 6], R_cn, r_FC_n)
    assert again == pytest.approx(rows[:, :3], rel=1e-10, abs=1e-10)


def test_noise_from_points_equals_the_numerical_jacobian() -> None:
    points = np.array([[0.2, -0.1], [0.17, -0.11], [0.23, -0.08]])
    sigmas = np.array([1.0, 2.0, 3.0]) / F_PX
    h, J = 1e-6, np.zeros((3, 6))
    for i in range(6):
        step = np.zeros(6)
        step[i] = h
        up, down = (camera_angles.angles_from_points(points + s * step.reshape(3, 2)) for s in (1, -1))
        J[:, i] = (up - down) / (2 * h)
    J[2, :2] = 0.0  # the center's influence on alpha, which the function neglects ...
    expected = J @ np.diag(np.repeat(sigmas, 2) ** 2) @ J.T
    ours = camera_angles.noise_from_points(points, sigmas)
    assert np.diag(ours) == pytest.approx(np.diag(expected), rel=1e-8)
    assert np.array_equal(ours, np.diag(np.diag(ours)))
    # ... together with the correlation of azimuth and elevation, which is nil: each has its own coordinate
    assert expected[0, 1] == pytest.approx(0.0, abs=1e-18)


def test_noise_from_points_equals_monte_carlo_seed_3() -> None:
    points = np.array([[0.1, 0.05], [0.05, 0.04], [0.15, 0.06]])
    sigmas = np.full(3, 1.0 / F_PX)
    rng = np.random.default_rng(3)
    draws = np.array(
        [camera_angles.angles_from_points(points + rng.normal(0, sigmas[0], (3, 2))) for _ in range(20_000)]
    )
    ours = np.sqrt(np.diag(camera_angles.noise_from_points(points, sigmas)))
    assert np.std(draws, axis=0) == pytest.approx(ours, rel=0.02)  # the spread of 20 000 draws: 0.5 %
