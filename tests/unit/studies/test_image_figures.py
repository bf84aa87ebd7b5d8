"""Figures 6 and 7 of Oh & Johnson: what they draw is what the flight had."""

import msgspec
import numpy as np
import pytest

from onboard.models import camera_angles
from simlink.scenarios.camera import Camera
from simlink.scenarios.scenario import load_scenario
from studies.relative_motion.flight import Flight, fly
from studies.relative_motion.image_figures import true_angles

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


def test_the_camera_matters_seed_3(flight: Flight) -> None:
    assert np.abs(true_angles(flight, CAMERA) - true_angles(flight, Camera()))[:, :2].min() > np.radians(1)
