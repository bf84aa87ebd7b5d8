"""The slot's height that keeps the leader inside the image."""

import math

import pytest

from onboard.autopilot.framing import Framing
from onboard.geometry.camera import make_camera
from onboard.geometry.rotations import quaternion_from_euler

HALF = math.degrees(math.atan2(240.0, 554.0))


def lift(mount_up_deg: float, pitch_deg: float, yaw_deg: float = 0.0, gimbal: int | None = None) -> float:
    """After a minute at that pitch, 30 m behind and 3 m below."""
    mount = (0.0, mount_up_deg, yaw_deg)
    camera = make_camera(f_px=554.0, width_px=640.0, height_px=480.0, mount_rpy_deg=mount, gimbal=gimbal)
    w, x, y, z = quaternion_from_euler(0.3, math.radians(pitch_deg), 1.0).tolist()
    framing = Framing((-30.0, 0.0, 3.0))
    for _ in range(600):
        framing.update(camera, (w, x, y, z), 0.1)
    return framing.lift


def test_a_leader_well_inside_the_image_leaves_the_slot_as_it_is() -> None:
    assert [lift(15.0, 0.0), lift(15.0, -8.0), lift(0.0, -6.0)] == pytest.approx([0.0] * 3, abs=1e-9)


@pytest.mark.parametrize(("mount", "pitch"), [(-10.0, -6.0), (0.0, -20.0), (30.0, 0.0)])
def test_else_the_leader_is_ten_degrees_inside_the_nearer_edge(mount: float, pitch: float) -> None:
    elevation = math.degrees(math.atan2(3.0 + lift(mount, pitch), 30.0))
    assert abs(elevation - mount - pitch) == pytest.approx(HALF - 10.0, abs=0.01)
    assert (lift(mount, pitch) > 0.0) is (mount + pitch > 0.0)  # lower, where the camera looks up too far


def test_a_camera_that_looks_elsewhere_or_moves_changes_nothing() -> None:
    assert lift(-20.0, 0.0, yaw_deg=180.0) == lift(-20.0, 0.0, gimbal=154) == 0.0


def test_the_height_changes_slowly_and_within_bounds() -> None:
    camera = make_camera(f_px=554.0, width_px=640.0, height_px=480.0, mount_rpy_deg=(0.0, -60.0, 0.0))
    framing = Framing((-30.0, 0.0, 3.0))
    heights = [framing.update(camera, (1.0, 0.0, 0.0, 0.0), 0.1) for _ in range(600)]
    assert heights[9] == pytest.approx(-0.5)
    assert heights[-1] == pytest.approx(-15.0)


def test_the_pitch_counts_by_its_mean_over_five_seconds() -> None:
    camera, framing = make_camera(f_px=554.0, width_px=640.0, height_px=480.0), Framing((-30.0, 0.0, 3.0))
    for k in range(51):
        w, x, y, z = quaternion_from_euler(0.0, math.radians(-20.0) * (k > 0), 0.0).tolist()
        framing.update(camera, (w, x, y, z), 0.1)
    assert framing._pitch == pytest.approx(math.radians(-20.0) * (1.0 - math.exp(-1.0)), rel=0.02)
