"""Frames, rotations, camera and geodesy, against literal numbers and third parties.

The simulator shares these modules, so an error here would cancel in closed loop: no test is a mere round trip.
"""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from onboard.arrays import Array
from onboard.geometry import geodesy, rotations
from onboard.geometry.camera import make_camera, pixels_from_points, project

ANGLE = st.floats(-math.pi, math.pi)
TILT = st.floats(-1.5, 1.5)
C30, S30 = math.cos(math.pi / 6), 0.5


def to_scipy(q_nb: Array) -> Rotation:
    return Rotation.from_quat(np.roll(q_nb, -1))  # theirs has the scalar last


# ------------------------------------------------------------------------------------------ rotations


@given(st.tuples(ANGLE, TILT, ANGLE))
def test_a_rotation_vector_is_that_of_scipy(angles: tuple[float, float, float]) -> None:
    q = rotations.quaternion_from_euler(*angles)
    for same in (q, -q):
        phi = rotations.vector_from_quaternion(same)
        assert to_scipy(q).as_matrix() == pytest.approx(Rotation.from_rotvec(phi).as_matrix(), abs=1e-9)
        assert np.linalg.norm(phi) <= math.pi + 1e-12
    assert rotations.vector_from_quaternion((1.0, 2e-10, 0.0, 0.0)) == pytest.approx([4e-10, 0.0, 0.0])


def test_yaw_takes_the_nose_from_north_to_east() -> None:
    R_nb = rotations.matrix_from_euler(0.0, 0.0, math.pi / 2)
    assert R_nb @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)


def test_pitch_up_raises_the_nose() -> None:
    R_nb = rotations.matrix_from_euler(0.0, math.pi / 6, 0.0)
    assert R_nb @ [1.0, 0.0, 0.0] == pytest.approx([C30, 0.0, -S30], abs=1e-15)  # down is positive


def test_roll_right_lowers_the_right_wing() -> None:
    R_nb = rotations.matrix_from_euler(math.pi / 6, 0.0, 0.0)
    assert R_nb @ [0.0, 1.0, 0.0] == pytest.approx([0.0, C30, S30], abs=1e-15)


@given(ANGLE, TILT, ANGLE)
def test_euler_sequence_is_zyx(roll: float, pitch: float, yaw: float) -> None:
    theirs = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    assert rotations.matrix_from_euler(roll, pitch, yaw) == pytest.approx(theirs, abs=1e-14)
    q_nb = rotations.quaternion_from_euler(roll, pitch, yaw)
    assert to_scipy(q_nb).as_matrix() == pytest.approx(theirs, abs=1e-14)
    difference = rotations.euler_from_quaternion(q_nb) - to_scipy(q_nb).as_euler("ZYX")[::-1]
    assert rotations.wrap_angle(difference) == pytest.approx(np.zeros(3), abs=1e-9)  # pi and -pi are the same


@given(ANGLE, TILT, ANGLE)
def test_quaternion_from_matrix_is_that_of_scipy(roll: float, pitch: float, yaw: float) -> None:
    R_nb = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    ours = rotations.quaternion_from_matrix(R_nb)
    assert ours[0] >= 0
    theirs = np.roll(Rotation.from_matrix(R_nb).as_quat(), 1)
    assert min(np.abs(ours - theirs).max(), np.abs(ours + theirs).max()) < 1e-14


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_quaternion_from_vector_is_the_exponential(phi: tuple[float, float, float]) -> None:
    theirs = Rotation.from_rotvec(phi).as_matrix()
    assert rotations.matrix_from_quaternion(rotations.quaternion_from_vector(phi)) == pytest.approx(
        theirs, abs=1e-14
    )


@given(ANGLE, TILT, ANGLE, ANGLE, TILT, ANGLE, st.floats(0.0, 1.0))
def test_slerp_is_that_of_scipy(
    a: float, b: float, c: float, d: float, e: float, f: float, fraction: float
) -> None:
    q0, q1 = rotations.quaternion_from_euler(a, b, c), rotations.quaternion_from_euler(d, e, f)
    ours = rotations.matrix_from_quaternion(rotations.slerp(q0, q1, fraction))
    if abs(float(q0 @ q1)) < 1e-6:  # half a turn apart: both ways are shortest
        return
    both = Rotation.concatenate([to_scipy(q0), to_scipy(q1)])
    assert ours == pytest.approx(Slerp([0.0, 1.0], both)(fraction).as_matrix(), abs=1e-7)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (3.5, 3.5 - 2 * math.pi),
        (-3.5, 2 * math.pi - 3.5),
        (7.0, 7.0 - 2 * math.pi),
    ],
)
def test_wrap_angle(angle: float, wrapped: float) -> None:
    assert float(rotations.wrap_angle(angle)) == pytest.approx(wrapped, abs=1e-15)


# --------------------------------------------------------------------------------------------- camera


def test_a_camera_pitched_up_has_15_degrees_above_the_horizon_in_its_centre() -> None:
    camera = make_camera(f_px=500.0, width_px=640.0, height_px=480.0, mount_rpy_deg=(0.0, 15.0, 0.0))
    up_15 = np.array([math.cos(math.radians(15)), 0.0, -math.sin(math.radians(15))])
    assert project(camera.R_bc.T @ (100.0 * up_15)) == pytest.approx([0.0, 0.0], abs=1e-15)
    # and the horizon then lies below the centre: 500 tan 15 deg = 133.97 px
    horizon = project(camera.R_bc.T @ np.array([100.0, 0.0, 0.0]))
    assert pixels_from_points(horizon, camera) == pytest.approx([320.0, 240.0 + 133.9746], abs=1e-3)


def test_right_and_below_are_positive() -> None:
    camera = make_camera(f_px=500.0, width_px=640.0, height_px=480.0)
    point = project([10.0, 1.0, 2.0])
    assert point == pytest.approx([0.1, 0.2], abs=1e-16)
    assert pixels_from_points(point, camera) == pytest.approx([370.0, 340.0], abs=1e-12)


# -------------------------------------------------------------------------------------------- geodesy


@pytest.mark.parametrize(
    ("geodetic", "r_e"),
    [
        ((0.0, 0.0, 0.0), (6378137.0, 0.0, 0.0)),
        ((0.0, 90.0, 100.0), (0.0, 6378237.0, 0.0)),
        ((0.0, -180.0, 0.0), (-6378137.0, 0.0, 0.0)),
        ((90.0, 0.0, 0.0), (0.0, 0.0, 6356752.314245)),
        ((-90.0, 0.0, 10.0), (0.0, 0.0, -6356762.314245)),
    ],
)
def test_ecef_of_points_that_are_known(
    geodetic: tuple[float, float, float], r_e: tuple[float, float, float]
) -> None:
    assert geodesy.ecef_from_geodetic(*geodetic) == pytest.approx(r_e, abs=1e-6)
    lat, lon, height = geodesy.geodetic_from_ecef(r_e)
    assert lat == pytest.approx(geodetic[0], abs=1e-11)
    assert height == pytest.approx(geodetic[2], abs=1e-6)
    if abs(lat) < 90:
        assert math.cos(math.radians(lon - geodetic[1])) == pytest.approx(1.0, abs=1e-15)


LATITUDE = st.one_of(st.floats(-90.0, 90.0), st.sampled_from([-90.0, -45.0, 0.0, 45.0, 90.0]))
LONGITUDE = st.one_of(st.floats(-180.0, 180.0), st.sampled_from([-180.0, 180.0, 179.9999999]))


@given(LATITUDE, LONGITUDE, st.floats(-500.0, 50_000.0))
def test_ecef_is_that_of_pymap3d(lat: float, lon: float, height: float) -> None:
    r_e = np.array(pymap3d.geodetic2ecef(lat, lon, height))
    assert geodesy.ecef_from_geodetic(lat, lon, height) == pytest.approx(r_e, abs=1e-8)
    again = geodesy.geodetic_from_ecef(r_e)
    back = np.array(pymap3d.geodetic2ecef(*again))
    assert back == pytest.approx(r_e, abs=1e-7)
    assert again[0] == pytest.approx(lat, abs=1e-11)
    assert again[2] == pytest.approx(height, abs=1e-7)


OFFSET = st.tuples(*[st.floats(-20_000.0, 20_000.0)] * 3)


@given(st.floats(-89.0, 89.0), LONGITUDE, OFFSET)
def test_ned_is_that_of_pymap3d(lat: float, lon: float, r_OP_n: tuple[float, float, float]) -> None:
    origin = (lat, lon, 300.0)
    point = geodesy.geodetic_from_ned(r_OP_n, origin)
    theirs = pymap3d.ned2geodetic(*r_OP_n, *origin)
    assert pymap3d.geodetic2ned(*point, *origin) == pytest.approx(r_OP_n, abs=1e-6)
    assert geodesy.ned_from_geodetic(tuple(float(x) for x in theirs), origin) == pytest.approx(r_OP_n, abs=1e-6)


def test_a_step_across_the_antimeridian_is_short() -> None:
    """0.002 degrees of longitude at the equator: 6378137 rad(0.002) = 222.64 m to the east."""
    step = geodesy.ned_from_geodetic((0.0, -179.999, 0.0), (0.0, 179.999, 0.0))
    assert step == pytest.approx([0.0, 222.639, 0.0039], abs=1e-3)
