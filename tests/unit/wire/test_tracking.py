"""Whole aircraft in MAVLink: CAMERA_TRACKING_IMAGE_STATUS, and LANDING_TARGETs with a size or a position."""

import math
import struct
from typing import Any

import pytest
from numpy.testing import assert_allclose

from onboard.config import ConfigError, parse_config
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.messages import Clock, FieldOfView, Message, TargetDetection
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.tracking import TrackerDecoder
from tests.support.images import detections
from tests.support.mavlink_frames import RECEIVE_TIME_NS, frame
from tests.support.streams import EPOCH, Item, encode, feed, heartbeat
from tests.unit.wire.test_landing_target import labelled

NAN = math.nan
F = 554.256
DISTORTED = {"distortion": [-0.28, 0.07, 0.0, 0.0]}


def decoded(data: bytes, **camera: Any) -> tuple[list[Message], list[str]]:
    """Messages, and why others are refused."""
    reasons: list[str] = []
    inputs = parse_config({"camera": camera}).camera_inputs()
    trackers = TrackerDecoder(inputs, lambda why, _: reasons.append(why.words))
    messages = MavlinkDecoder(stream=False, trackers=trackers).decode(data, RECEIVE_TIME_NS)
    return detections(m for m in messages if not isinstance(m, FieldOfView)), reasons


def one(data: bytes, **camera: Any) -> TargetDetection:
    (message,), reasons = decoded(data, **camera)
    assert reasons == []
    assert isinstance(message, TargetDetection)
    return message


def tracking(
    *, point: tuple[float, ...] = (NAN,) * 3, rect: tuple[float, ...] = (NAN,) * 4, status: int = 1, mode: int = 1
) -> bytes:
    return frame(275, 126, struct.pack("<7f4B", *point, *rect, status, mode, 4, 0), component=100)


def landing(
    *,
    angles: tuple[float, float] = (0.0, 0.0),
    size: tuple[float, float] = (0.0, 0.0),
    number: int = 0,
    r: tuple[float, float, float] | None = None,
    frame_: int = 12,
    distance: float = 0.0,
    q: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0),
) -> bytes:
    fields = (
        5_000_000,
        *angles,
        distance,
        *size,
        number,
        frame_,
        *(r or (0.0,) * 3),
        *q,
        0,
        r is not None,
    )
    return frame(149, 200, struct.pack("<Q5f2B7f2B", *fields), component=100)


# ---------------------------------------------------------------------------------------- camera tracking


def zoomed(hfov: float, component: int = 100) -> bytes:
    return frame(
        271, 22, struct.pack("<I6i6f", 5_000, *[0] * 6, 1.0, 0.0, 0.0, 0.0, hfov, 20.0), component=component
    )


@pytest.mark.parametrize(
    ("says", "zoom"),
    [
        ("twice", 2.0),
        ("half", 0.5),
        ("nearly as configured", 1.0),
        ("nan", 1.0),
        ("zero", 1.0),
        ("another camera", 1.0),
    ],
)
def test_a_tracking_camera_that_zooms_says_its_focal_length(says: str, zoom: float) -> None:
    """CAMERA_FOV_STATUS, as ArduPilot and QGroundControl use it."""
    plain = one(tracking(rect=(0.5, 0.25, 0.6, 0.35), mode=2), tracker=100)
    width, f_px = 640.0, 554.256
    of = lambda k: math.degrees(2.0 * math.atan(width / 2 / (k * f_px)))  # noqa: E731
    hfov = {"twice": of(2.0), "half": of(0.5), "nearly as configured": of(1.02), "nan": NAN, "zero": 0.0}.get(says)
    status = zoomed(of(2.0), component=101) if hfov is None else zoomed(hfov)
    m = one(status + tracking(rect=(0.5, 0.25, 0.6, 0.35), mode=2), tracker=100)
    assert m.half_width == pytest.approx(plain.half_width / zoom, rel=1e-5)
    assert m.features[0].point == pytest.approx([x / zoom for x in plain.features[0].point], rel=1e-5)


@pytest.mark.parametrize("hfov", [1e-15, 1e-6, 179.9999, 180.0, -20.0, math.inf])
def test_a_field_of_view_that_no_zoom_has_is_refused_and_named(hfov: float) -> None:
    messages, (reason,) = decoded(zoomed(hfov) + tracking(rect=(0.5, 0.25, 0.6, 0.35), mode=2), tracker=100)
    assert messages == decoded(tracking(rect=(0.5, 0.25, 0.6, 0.35), mode=2), tracker=100)[0]
    assert reason == f"CAMERA_FOV_STATUS: an hfov of {hfov:.7g} degrees is no zoom of the configured lens"


def test_a_tracked_rectangle_is_a_box_at_its_arrival() -> None:
    m = one(tracking(rect=(0.5, 0.25, 0.6, 0.35), mode=2), tracker=100)
    (box,) = m.features
    assert (box.name, m.clock, m.t_ns, m.component, m.camera) == ("box", Clock.HOST, RECEIVE_TIME_NS, 100, "front")
    assert_allclose(box.point, (32 / F, -96 / F), rtol=1e-6)
    assert m.half_width == pytest.approx(32 / F)


def test_a_tracked_point_is_a_box_with_its_radius_or_the_center() -> None:
    m = one(tracking(point=(0.75, 0.5, 0.02)), tracker=100)
    assert (m.features[0].name, m.half_width) == ("box", pytest.approx(12.8 / F))
    assert_allclose(m.features[0].point, (160 / F, 0.0), atol=1e-9)
    assert one(tracking(point=(0.75, 0.5, NAN)), tracker=100).features[0].name == "center"


def test_only_what_the_configured_camera_tracks_now_is_used() -> None:
    for data, camera in (
        (tracking(point=(0.5, 0.5, 0.1)), {}),
        (tracking(point=(0.5, 0.5, 0.1)), {"tracker": 101}),
        (tracking(point=(0.5, 0.5, 0.1), status=0), {"tracker": 100}),
        (tracking(point=(0.5, 0.5, 0.1), status=9), {"tracker": 100}),
    ):
        assert decoded(data, **camera) == ([], [])


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (tracking(), "expected a point or rectangle from 0 to 1"),
        (tracking(point=(1.2, 0.5, 0.1)), "expected a point or rectangle from 0 to 1"),
        (tracking(mode=0), "expected a point or rectangle from 0 to 1"),
        (tracking(rect=(0.6, 0.2, 0.5, 0.3), mode=2), "a rectangle from 0 to 1, its top left first"),
        (tracking(rect=(0.6, 0.2, NAN, 0.3), mode=2), "a rectangle from 0 to 1, its top left first"),
    ],
)
def test_a_target_that_is_nowhere_is_refused(data: bytes, expected: str) -> None:
    messages, (reason,) = decoded(data, tracker=100)
    assert messages == []
    assert reason == f"CAMERA_TRACKING_IMAGE_STATUS: {expected}"


# ----------------------------------------------------------------------------------------- landing target


def test_a_landing_target_with_a_size_is_a_box() -> None:
    m = one(landing(angles=(0.1, -0.05), size=(0.04, 0.02)), landing_target="aircraft", **DISTORTED)
    (box,) = m.features
    assert (box.name, m.target, m.t_ns, m.clock) == ("box", "leader", 5_000_000_000, Clock.BOOT)
    assert_allclose(box.point, (math.tan(0.1), math.tan(-0.05)), rtol=1e-3)
    assert m.half_width == pytest.approx((math.tan(0.12) - math.tan(0.08)) / 2)
    assert m.view is not None
    assert m.view[0] < -320 / F


def test_a_landing_target_without_a_size_is_a_center_of_the_target_of_its_number() -> None:
    m = one(landing(angles=(0.1, -0.05), number=2), landing_target="aircraft")
    assert (m.features[0].name, m.target) == ("center", "target/2")
    assert_allclose(m.features[0].point, (math.tan(0.1), math.tan(-0.05)), rtol=1e-6)


def test_a_position_is_a_direction_from_where_the_camera_is() -> None:
    camera = {"mount_rpy_deg": [0.0, 10.0, 5.0], "mount_offset_m": [0.5, 0.2, -0.1], "landing_target": "aircraft"}
    r = (20.0, 3.0, -2.0)
    forward, right, down = matrix_from_euler(0.0, math.radians(10), math.radians(5)).T @ [19.5, 2.8, -1.9]
    m = one(landing(r=r), **camera)
    assert m.features[0].name == "center"
    assert_allclose(m.features[0].point, (right / forward, down / forward), rtol=1e-5)
    assert m.features[0].sigma == pytest.approx(1 / F, rel=0.05)
    assert m.pose is not None
    assert m.pose.r_CL_c == pytest.approx((forward, right, down))
    assert m.pose.q_cL is None  # q is (1, 0, 0, 0), as of who knows none


def test_the_rotation_beside_a_position_is_the_aircraft_s_in_our_body_s_axes() -> None:
    """A leader whose nose points 90 degrees to our right, in a camera that looks 5 degrees to the right."""
    camera = {"mount_rpy_deg": [0.0, 0.0, 5.0], "landing_target": "aircraft"}
    half = math.radians(45)
    m = one(landing(r=(20.0, 0.0, 0.0), q=(math.cos(half), 0.0, 0.0, math.sin(half))), **camera)
    assert m.pose is not None
    assert m.pose.q_cL is not None
    nose = matrix_from_quaternion(m.pose.q_cL)[:, 0]
    assert_allclose(nose, (math.sin(math.radians(5)), math.cos(math.radians(5)), 0.0), atol=1e-6)
    for unknown in ((0.0,) * 4, (NAN,) * 4):
        pose = one(landing(r=(20.0, 0.0, 0.0), q=unknown), **camera).pose
        assert pose is not None
        assert pose.q_cL is None


@pytest.mark.parametrize(("distance", "expected"), [(28.5, 28.5), (0.0, None), (NAN, None), (-1.0, None)])
@pytest.mark.parametrize("size", [(0.0, 0.0), (0.04, 0.02)])
def test_a_distance_without_a_position_is_a_range(
    distance: float, expected: float | None, size: tuple[float, float]
) -> None:
    assert one(landing(distance=distance, size=size), landing_target="aircraft").range == expected


@pytest.mark.parametrize(
    ("data", "camera", "expected"),
    [
        (landing(angles=(1.6, 0.0)), {}, "angle_x and angle_y must be within 90 degrees of the axis"),
        (landing(angles=(NAN, 0.0)), {}, "angle_x and angle_y must be within 90 degrees of the axis"),
        (landing(size=(-0.1, 0.0)), {}, "size_x and size_y must be 0 (not known) or positive angles"),
        (landing(r=(-5.0, 0.0, 0.0)), {}, "the position x, y, z is behind the camera"),
        (landing(r=(5.0, NAN, 0.0)), {}, "a position in frame 12; expected MAV_FRAME_BODY_FRD (12)"),
        (landing(r=(5.0, 0.0, 0.0), frame_=1), {}, "a position in frame 1; expected MAV_FRAME_BODY_FRD (12)"),
        (landing(r=(5.0, 0.0, 0.0)), {"gimbal": 1}, "a position needs a camera with a fixed mount"),
    ],
)
def test_a_landing_target_that_cannot_be_is_refused(data: bytes, camera: dict[str, Any], expected: str) -> None:
    messages, (reason,) = decoded(data, landing_target="aircraft", **camera)
    assert messages == []
    assert reason == f"LANDING_TARGET: {expected}"


def test_as_ever_three_landing_targets_are_one_aircraft_where_nothing_else_is_configured() -> None:
    messages, reasons = decoded(b"".join(labelled()))
    assert ([type(m).__name__ for m in messages], reasons) == (["TargetPoints"], [])


# ------------------------------------------------------------------------------------- the whole program


def test_a_refusal_is_named_with_its_link() -> None:
    settings = parse_config({"camera": {"tracker": 100}, "estimator": {"leader": {}}})
    (beat,) = encode([Item(EPOCH, heartbeat(0))])
    bad = type(beat)(channel="radio", encoding=beat.encoding, t_recv_ns=EPOCH, data=tracking())
    run = feed([beat, bad], settings)
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert (refusal.source, run.rejected["bad_tracking"]) == ("radio", 1)
    assert refusal.reason.startswith("CAMERA_TRACKING_IMAGE_STATUS: expected")


@pytest.mark.parametrize(
    ("camera", "message", "expected"),
    [
        (
            {"tracker": 100},
            "CAMERA_TRACKING_IMAGE_STATUS",
            r"tracker is 100, but \[\[leader_out\]\] sends as this",
        ),
        (
            {"landing_target": "aircraft"},
            "LANDING_TARGET",
            r"landing_target: \[\[leader_out\]\] sends LANDING_TARGET",
        ),
    ],
)
def test_what_we_send_ourselves_cannot_be_a_camera_s(camera: dict[str, Any], message: str, expected: str) -> None:
    out = {"link": "autopilot", "rates_hz": {message: 1.0}}
    with pytest.raises(ConfigError, match=expected):
        parse_config({"camera": camera, "leader_out": [out]})
