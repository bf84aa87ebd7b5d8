"""Where the camera sits on our vehicle counts: in its view, and in flight."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.estimators.leader.image.camera_pose import CameraPoses
from onboard.geometry.camera import make_camera
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_euler
from onboard.messages import Attitude, GimbalAttitude, LocalPosition, MountAttitude
from onboard.ownship import Ownship
from tests.support.streams import MS, S

OFFSET = (1.5, -2.0, 0.8)
MOUNT_DEG = (5.0, 15.0, -10.0)


def ownship(rpy: tuple[float, float, float], omega: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Ownship:
    """Us at one attitude for a second, and turning at omega_b, rad/s, about it at the end."""
    known = Ownship(max_extrapolation=0.1)
    R_nb = matrix_from_euler(*rpy)
    for ms in range(0, 1001, 20):
        common = {"t_ns": ms * MS, "t_recv_ns": ms * MS}
        q = quaternion_from_euler(*rpy)
        known.receive(Attitude(**common, q_nb=tuple(q.tolist()), omega_b=omega), ms * MS)
        v = tuple((R_nb @ [7.0, 0.0, 0.0]).tolist())
        known.receive(LocalPosition(**common, r_OF_n=(0.0, 0.0, -50.0), v_F_n=v), ms * MS)
    return known


def test_the_camera_is_where_the_mount_puts_it_and_looks_where_it_points() -> None:
    camera = make_camera(f_px=500.0, width_px=640, height_px=480, mount_rpy_deg=MOUNT_DEG, mount_offset=OFFSET)
    rpy = (0.4, -0.2, 2.0)
    view = CameraPoses(camera).at(S, ownship(rpy))
    assert view is not None
    R_nb = matrix_from_euler(*rpy)
    assert_allclose(view.r_FC_n, R_nb @ OFFSET, atol=1e-12)
    assert_allclose(view.R_cn, (R_nb @ matrix_from_euler(*np.radians(MOUNT_DEG))).T, atol=1e-12)
    assert_allclose(view.v_F_n, R_nb @ [7.0, 0.0, 0.0], atol=1e-12)
    assert_allclose(view.omega_c, 0.0, atol=1e-12)


@pytest.mark.parametrize("flagged", ["heading", "earth"])
@pytest.mark.parametrize(("frame", "is_fixed"), [("", False), ("body", True), ("earth", False)])
def test_a_servo_gimbal_sends_angles_against_the_body_whatever_its_flags_say(
    flagged: str, frame: str, is_fixed: bool
) -> None:
    """It stands still on the body, which banks: so does the camera."""
    rpy = (0.4, -0.2, 2.0)
    known = ownship(rpy)
    mount = MountAttitude(q=(1.0, 0.0, 0.0, 0.0), frame=flagged)
    known.receive(GimbalAttitude(t_ns=S, t_recv_ns=S, device=1, mount=mount), S)
    camera = make_camera(f_px=500.0, width_px=640, height_px=480, gimbal=1)
    pose = CameraPoses(dataclasses.replace(camera, gimbal_frame=frame)).at(S, known)
    assert pose is not None
    assert np.allclose(pose.R_cn.T, matrix_from_euler(*rpy), atol=1e-6) is is_fixed


@pytest.mark.parametrize("distance", [0.5, 3.0, 40.0])
def test_what_is_within_the_field_of_view_is_seen_however_far_it_is(distance: float) -> None:
    camera = make_camera(f_px=500.0, width_px=640, height_px=480)
    poses, known = CameraPoses(camera), ownship((0.0, 0.0, 0.0))
    for slope, is_seen in ((0.0, True), (0.99, True), (1.01, False)):
        right, down = 0.64 * slope * distance, 0.48 * slope * distance
        for r in ((distance, right, 0.0), (distance, -right, 0.0), (distance, 0.0, down), (distance, 0.0, -down)):
            assert poses.see(np.array(r), S, known) is is_seen
    assert not poses.see(np.array([-distance, 0.0, 0.0]), S, known)
