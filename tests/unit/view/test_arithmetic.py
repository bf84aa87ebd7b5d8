"""The numbers behind the picture, against figures worked out by hand."""

import math

import numpy as np
import pytest

from onboard.geometry.camera import make_camera
from onboard.geometry.rotations import euler_from_quaternion
from onboard.view import motion
from tests.support.vehicle_records import truth
from tests.support.view_flight import NEEDS_RERUN


def test_range_along_an_axis() -> None:
    mean = np.array([0.0, 30.0, 0.0, 5.0, -2.0, 1.0, 2.0, 0.0, 0.0])
    leader = motion.LeaderArrays(t_ns=0, mean=mean, covariance=np.diag([0.25, 4.0, *[1.0] * 7]))
    assert motion.range_estimate(leader) == pytest.approx(
        (30.0, 2.0, 2.0, 1.0)
    )  # range, its sigma, closing, the larger sigma across


def test_an_ellipsoid_is_its_covariance_again() -> None:
    half = np.array([[2.0, 0.3, -0.1], [0.0, 1.0, 0.4], [0.0, 0.0, 0.2]])
    P = half @ half.T
    half_axes, R = motion.ellipsoid(P, 3.0)
    np.testing.assert_allclose(R @ np.diag(half_axes**2) @ R.T, 9.0 * P, atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("v_n", "pitch_deg", "yaw_deg"),
    [
        ((10, 0, 0), 0, 0),
        ((0, 10, 0), 0, 90),
        ((-10, 0, 0), 0, 180),
        ((10, 0, -10), 45, 0),
        ((0, -5, 5), -45, -90),
    ],
)
def test_course_points_the_nose_along_the_velocity(
    v_n: tuple[float, float, float], pitch_deg: float, yaw_deg: float
) -> None:
    roll, pitch, yaw = np.degrees(euler_from_quaternion(motion.course_quaternion(v_n)))
    assert (roll, pitch, yaw) == pytest.approx((0.0, pitch_deg, yaw_deg), abs=1e-9)


def test_truth_between_two_records_and_nowhere_else() -> None:
    places = {1_000_000_000: 10.0, 1_100_000_000: 20.0, 2_000_000_000: 30.0}
    history = [truth(t_ns, r_FL_n=(north, 0.0, 0.0)) for t_ns, north in places.items()]
    between = motion.truth_at(history, 1_025_000_000)
    assert between is not None
    assert between[0] == pytest.approx(12.5)
    for t_ns in (999_999_999, 2_000_000_001, 1_500_000_000):  # before, after, in a gap of 0.9 s
        assert motion.truth_at(history, t_ns) is None


def test_pixels_are_those_of_the_image_and_finite() -> None:
    image = pytest.importorskip("onboard.view.image", reason=NEEDS_RERUN, exc_type=ImportError)
    camera = make_camera(f_px=600.0, width_px=640.0, height_px=480.0)
    px = image.pixels(((0.0, 0.0), (math.nan, 0.0), (0.1, -0.1)), camera)
    np.testing.assert_allclose(px, [(320.0, 240.0), (380.0, 180.0)])
    # five times as far from the middle of the strip below the image; what falls outside is left out
    close = image.magnify(
        np.array([(320.0, 240.0), (330.0, 236.0), (400.0, 240.0)]), np.array([320.0, 240.0]), camera
    )
    np.testing.assert_allclose(close, [(320.0, 619.2), (370.0, 599.2)])


def test_drawing_is_no_faster_than_asked() -> None:
    memory = pytest.importorskip("onboard.view.memory").Memory()
    drawn = sum(memory.is_due("leader", k * 10_000_000, 25.0) for k in range(1000))  # 100 Hz for 10 s
    assert 250 <= drawn <= 280
