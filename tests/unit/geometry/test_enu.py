"""ROS's axes against constants of others: MAVROS's rotations, pymap3d's frames, and attitudes known by heart."""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from onboard.geometry.enu import ENU_NED, FLU_FRD, flu_to_enu
from onboard.geometry.rotations import quaternion_from_euler

# MAVROS's ftf: q_enu = NED_ENU * q_ned * AIRCRAFT_BASELINK, of roll, pitch and yaw about fixed axes
NED_ENU = Rotation.from_euler("xyz", [math.pi, 0.0, math.pi / 2])
AIRCRAFT_BASELINK = Rotation.from_euler("xyz", [math.pi, 0.0, 0.0])
ANGLE = st.floats(-math.pi, math.pi)


@given(ANGLE, st.floats(-1.5, 1.5), ANGLE)
def test_any_attitude_is_that_of_mavros(roll: float, pitch: float, yaw: float) -> None:
    q = quaternion_from_euler(roll, pitch, yaw)
    theirs = NED_ENU * Rotation.from_quat(q, scalar_first=True) * AIRCRAFT_BASELINK
    assert_allclose(flu_to_enu(q), theirs.as_matrix(), atol=1e-12)


@given(*[st.floats(-1e3, 1e3)] * 3)
def test_any_place_is_that_of_pymap3d(north: float, east: float, down: float) -> None:
    origin = 47.4, 8.5, 500.0
    lat, lon, alt = pymap3d.ned2geodetic(north, east, down, *origin)
    assert_allclose(ENU_NED @ [north, east, down], pymap3d.geodetic2enu(lat, lon, alt, *origin), atol=1e-5)


@pytest.mark.parametrize(
    ("rpy_deg", "enu_rpy_deg"),
    [
        ((0, 0, 90), (0, 0, 0)),  # nose to the east
        ((0, 0, 0), (0, 0, 90)),  # to the north
        ((0, 20, 90), (0, -20, 0)),  # nose up: about the left axis, which points the other way
        ((30, 0, 90), (30, 0, 0)),  # right wing down
        ((0, 0, 180), (0, 0, -90)),
    ],
)
def test_attitudes_known_by_heart(rpy_deg: tuple[float, ...], enu_rpy_deg: tuple[float, ...]) -> None:
    ours = flu_to_enu(quaternion_from_euler(*np.radians(rpy_deg)))
    expected = Rotation.from_euler("xyz", enu_rpy_deg, degrees=True).as_matrix()
    assert_allclose(ours, expected, atol=1e-12)


def test_the_body_s_axes() -> None:
    assert (FLU_FRD @ [1.0, 2.0, 3.0]).tolist() == [1.0, -2.0, -3.0]
    assert np.linalg.det(ENU_NED) == pytest.approx(1.0)
