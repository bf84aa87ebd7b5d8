"""Figures 6 and 7 of Oh & Johnson: what they draw is what the flight had."""

import msgspec
import numpy as np
import pytest

from onboard.models import camera_angles
from simlink.scenarios.camera import Camera
from simlink.scenarios.scenario import load_scenario
from studies.relative_motion.flight import Flight, fly
from studies.relative_motion.image_figures import image_points, measured_angles, true_angles

SCENARIO = load_scenario("formation")
# turned and off our center, without noise, and often without an image
CAMERA = msgspec.structs.replace(
    SCENARIO.camera, sigma_px=0.0, mount_rpy_deg=(3.0, 8.0, -5.0), mount_offset=(1.0, 0.5, -0.3), p_lose=0.2
)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(msgspec.structs.replace(SCENARIO, camera=CAMERA), 3, 8.0)


def test_without_noise_the_angles_are_those_of_the_truth_seed_3(flight: Flight) -> None:
    """The wing is not quite across the sight, so that it seems a little narrower."""
    measured, true = camera_angles.angles_from_points(flight.image_points), true_angles(flight, CAMERA)
    seen = np.asarray(np.isfinite(measured).all(axis=1))
    assert 20 < seen.sum() < len(seen)
    np.testing.assert_allclose(measured[seen, :2], true[seen, :2], rtol=0, atol=1e-9)
    ratio = measured[seen, 2] / true[seen, 2]
    assert 0.9 < ratio.min() < ratio.max() < 1.02


def test_figure_6_shows_pixels_and_which_images_were_registered_seed_3(flight: Flight) -> None:
    right, down, flag = image_points(flight, CAMERA).axes
    for axis, coordinate in ((right, 0), (down, 1)):
        drawn = [line.get_ydata() for line in axis.lines]
        np.testing.assert_array_equal(drawn, CAMERA.f_px * flight.image_points[:, :, coordinate].T)
    (line,) = flag.lines
    np.testing.assert_array_equal(line.get_ydata(), np.isfinite(flight.image_points[:, 0, 0]))


def test_figure_7_shows_the_angles_in_degrees_seed_3(flight: Flight) -> None:
    axes = measured_angles(flight, CAMERA).axes
    measured = np.degrees(camera_angles.angles_from_points(flight.image_points))
    for i, axis in enumerate(axes):
        drawn, true = (line.get_ydata() for line in axis.lines)
        np.testing.assert_array_equal(drawn, measured[:, i])
        assert np.isfinite(np.asarray(true, dtype=float)).all()


def test_the_camera_matters_seed_3(flight: Flight) -> None:
    assert np.abs(true_angles(flight, CAMERA) - true_angles(flight, Camera()))[:, :2].min() > np.radians(1)
