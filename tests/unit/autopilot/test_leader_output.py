"""The leader over MAVLink, as an independent parser reads it."""

import math
import struct
from typing import Any

import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import common

from onboard.autopilot.leader_messages import CameraView
from onboard.autopilot.leader_output import LeaderOutput
from onboard.config import ConfigError, LeaderOutConfig, parse_config
from onboard.geometry.camera import make_camera
from onboard.messages import Datagram, Encoding
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.emitted import LEADER
from tests.support.leader import AUTOPILOT, S, T, leader_state, lost_state
from tests.support.mavlink_frames import crc_x25
from tests.support.vehicle_records import EAST

NOW = 1_800_000_000 * S
CAMERA = make_camera(f_px=500.0, width_px=640.0, height_px=480.0)
VIEW = CameraView((1.0, 0.0, 0.0, 0.0), CAMERA, is_px4=False)


def output(*names: Any, rate: float = 20.0) -> LeaderOutput:
    return LeaderOutput(LeaderOutConfig(link="a", system=99, rates_hz=dict.fromkeys(names, rate)), 7, 191)


def parsed(frames: list[bytes]) -> list[Any]:
    parser = common.MAVLink(None)
    return [m for frame in frames for m in parser.parse_buffer(frame) or []]


def only(name: str, view: CameraView = VIEW) -> Any:
    (m,) = (
        m for m in parsed(output(name).frames(leader_state(), leader_state(), view, NOW)) if m.get_type() == name
    )
    return m


def test_follow_target_is_what_ardupilot_follows() -> None:
    """Position, velocity, acceleration and attitude (bits 1, 2, 4, 8); no rates; yaw of the course: east."""
    m = only("FOLLOW_TARGET")
    assert m.custom_state == 0
    assert (m.get_srcSystem(), m.get_srcComponent()) == (99, 191)
    assert (m.timestamp, m.est_capabilities) == (20_000, 15)
    assert (m.lat, m.lon, m.alt) == (474_000_000, -85_000_000, 538.0)
    assert (tuple(m.vel), tuple(m.acc), tuple(m.rates)) == ((0.0, 8.0, -1.0), (0.0,) * 3, (0.0,) * 3)
    assert_allclose(m.attitude_q, EAST, atol=1e-7)
    assert tuple(m.position_cov) == (4.0, 9.0, 1.0)


def test_the_virtual_leader_has_a_position_of_its_own_and_a_heartbeat_a_second() -> None:
    m = only("GLOBAL_POSITION_INT")
    assert (m.get_srcSystem(), m.time_boot_ms, m.hdg) == (99, 20_000, 9000)
    assert (m.lat, m.lon, m.alt, m.relative_alt) == (474_000_000, -85_000_000, 538_000, 38_000)
    assert (m.vx, m.vy, m.vz) == (0, 800, -100)
    out = output("FOLLOW_TARGET")
    sent = [parsed(out.frames(leader_state(), leader_state(), VIEW, NOW + t * S // 20)) for t in range(100)]
    beats = [m for batch in sent for m in batch if m.get_type() == "HEARTBEAT"]
    assert [(b.get_srcSystem(), b.type, b.autopilot, b.system_status) for b in beats] == [(99, 18, 8, 4)] * 5
    assert sum(m.get_type() == "FOLLOW_TARGET" for batch in sent for m in batch) == 100


def test_a_rate_is_kept_by_a_timer_that_does_not_divide_it() -> None:
    out = output("ADSB_VEHICLE", rate=20.0)
    assert sum(
        len(out.frames(leader_state(), leader_state(), VIEW, NOW + t * 21_000_000)) for t in range(1000)
    ) == pytest.approx(420, abs=1)


def test_nothing_is_sent_of_an_estimate_that_is_not_valid_but_that_it_is_not() -> None:
    sent = parsed(output(*LEADER).frames(lost_state(), lost_state(), VIEW, NOW))
    assert [m.get_type() for m in sent] == [
        *("HEARTBEAT", "HEARTBEAT"),  # of the virtual leader and of the camera
        "CAMERA_TRACKING_IMAGE_STATUS",
        "CAMERA_TRACKING_GEO_STATUS",
    ]
    assert [m.tracking_status for m in sent[2:]] == [0, 0]
    assert (sent[1].get_srcComponent(), sent[1].type) == (100, 30)
    assert sent[0].system_status == 3  # standby
    assert all(math.isnan(x) for x in (sent[2].point_x, sent[3].alt, sent[3].dist))
    assert parsed(output(*LEADER).frames(None, None, None, NOW))[2:] == []


def test_numbers_of_an_estimate_that_is_not_valid_are_not_sent() -> None:
    """Predicted beyond what is valid, it still has all of them."""
    state = replace(leader_state(), valid=False)
    names = {m.get_type() for m in parsed(output(*LEADER).frames(state, state, VIEW, NOW))}
    assert names <= {"HEARTBEAT", "CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_TRACKING_GEO_STATUS"}


def test_without_the_origin_nothing_that_has_degrees_is_sent() -> None:
    state = leader_state(lat_deg=None, lon_deg=None, alt_msl=None)
    frames = output("FOLLOW_TARGET", "GLOBAL_POSITION_INT", "ADSB_VEHICLE").frames(state, state, VIEW, NOW)
    assert [m.get_type() for m in parsed(frames)] == ["HEARTBEAT"]


def test_target_relative_is_laid_out_as_in_mavlinks_definition() -> None:
    """Frame and CRC by hand: pymavlink has no TARGET_RELATIVE. Its definition, in the order of the wire."""
    fields = (
        (b"uint64_t timestamp", 0), (b"float x", 0), (b"float y", 0), (b"float z", 0), (b"float pos_std", 3),
        (b"float yaw_std", 0), (b"float q_target", 4), (b"float q_sensor", 4), (b"uint8_t id", 0),
        (b"uint8_t frame", 0), (b"uint8_t type", 0),
    )  # fmt: skip
    text = b"TARGET_RELATIVE "
    for declared, count in fields:
        text += declared + b" " + (bytes([count]) if count else b"")
    crc = crc_x25(text)
    extra = (crc & 0xFF) ^ (crc >> 8)
    (frame,) = output("TARGET_RELATIVE").frames(leader_state(), leader_state(), VIEW, NOW)
    assert frame[0] == 0xFD
    assert int.from_bytes(frame[7:10], "little") == 511
    assert (frame[5], frame[6], frame[1]) == (7, 191, 71)
    assert int.from_bytes(frame[-2:], "little") == crc_x25(frame[1:-2] + bytes([extra]))
    values = struct.unpack("<Q15f3B", frame[10:-2])
    assert values[0] == 1_800_000_000 * 1_000_000
    assert_allclose(values[1:8], (30, 4, 2, 1.5, 2.5, 0.5, math.atan2(0.5, 8.0)), rtol=1e-6)
    assert_allclose(values[8:16], (*EAST, 0, 0, 0, 0), atol=1e-7)
    assert values[16:] == (0, 2, 3)  # NED that travels with us; VISION_OTHER


def test_landing_target_is_in_the_frame_that_the_autopilot_reads() -> None:
    """Nose east: the leader, 30 m north, is to the left."""
    m = only("LANDING_TARGET", CameraView(EAST, CAMERA, is_px4=False))
    assert (m.frame, m.position_valid, m.time_usec) == (12, 1, 20_000_000)
    assert_allclose((m.x, m.y, m.z), (4.0, -30.0, 2.0), atol=1e-5)
    assert_allclose((m.angle_x, m.angle_y), (math.atan2(-30, 4), math.atan2(2, 4)), atol=1e-6)
    assert m.distance == pytest.approx(math.hypot(30, 4, 2))
    m = only("LANDING_TARGET", CameraView(EAST, CAMERA, is_px4=True))
    assert (m.frame, m.x, m.y, m.z) == (1, 130.0, 54.0, -38.0)


def test_the_leader_is_on_the_map() -> None:
    m = only("ADSB_VEHICLE")
    assert (m.get_srcSystem(), m.get_srcComponent()) == (7, 191)
    assert (m.ICAO_address, m.callsign, m.heading, m.hor_velocity, m.ver_velocity) == (
        0xF20000,
        "LEADER",
        9000,
        800,
        100,
    )
    assert (m.lat, m.lon, m.altitude) == (474_000_000, -85_000_000, 538_000)


def test_the_cameras_target_is_where_the_camera_sees_it() -> None:
    """30 m ahead, 4 m to the right, 2 m below: 66.7 px right of the middle and 33.3 px below it."""
    m = only("CAMERA_TRACKING_IMAGE_STATUS")
    assert (m.tracking_status, m.tracking_mode, m.target_data) == (1, 1, 4)
    assert_allclose((m.point_x, m.point_y), (0.5 + 500 * 4 / 30 / 640, 0.5 + 500 * 2 / 30 / 480), atol=1e-6)
    assert m.radius == pytest.approx(0.5 * 2.5 * 500 / math.hypot(30, 4, 2) / 640)
    behind = only("CAMERA_TRACKING_IMAGE_STATUS", CameraView((0.0, 0.0, 0.0, 1.0), CAMERA, is_px4=False))
    assert (behind.tracking_status, behind.target_data) == (1, 0)
    assert math.isnan(behind.point_x)
    m = only("CAMERA_TRACKING_GEO_STATUS")
    assert (m.lat, m.lon, m.alt) == (474_000_000, -85_000_000, 538.0)
    assert_allclose((m.h_acc, m.v_acc, m.vel_e), (math.hypot(2, 3), 1.0, 8.0), atol=1e-6)
    assert_allclose((m.dist, m.hdg), (math.hypot(30, 4, 2), math.atan2(4, 30)), atol=1e-6)


def test_the_virtual_leader_come_back_by_another_way_is_no_traffic_and_no_points() -> None:
    pipeline = Pipeline(
        parse_config({"estimator": {"traffic": {}}, "leader_out": [{"link": "autopilot", "system": 99}]})
    )
    names = ("GLOBAL_POSITION_INT", "LANDING_TARGET", "ADSB_VEHICLE")
    frames = [
        MavlinkEncoder(7, 1).encode(AUTOPILOT),
        *output(*names).frames(leader_state(), leader_state(), VIEW, NOW),
    ]
    for frame in frames:
        pipeline.feed(Datagram(channel="autopilot", encoding=Encoding.MAVLINK, t_recv_ns=T, data=frame))
    health = pipeline.health(2 * T)
    assert health.rejected["our_own"] == 3  # its heartbeat, its position, and the report of our own component
    assert health.rejected["landing_target_position"] == 1
    assert not any(name.startswith("traffic") for name in health.verdicts)


def test_it_is_off_unless_configured_and_mistakes_are_named() -> None:
    assert parse_config({}).leader_out == ()
    (out,) = parse_config({"leader_out": [{"link": "camera"}]}).leader_out
    assert (out.system, out.component, out.rates_hz) == (200, 191, {"FOLLOW_TARGET": 20.0})
    for wrong, message in (
        ({"link": "gcs"}, r"leader_out\[0\]\.link: no link has the name 'gcs'"),
        ({"link": "camera", "rates_hz": {"FOLLOW_ME": 1.0}}, "FOLLOW_ME"),
        ({"link": "camera", "rates_hz": {"FOLLOW_TARGET": 51.0}}, "<= 50"),
        ({"link": "camera", "rate": 1.0}, r"unknown key leader_out\[0\]\.rate"),
    ):
        with pytest.raises(ConfigError, match=message):
            parse_config({"leader_out": [wrong]})
    with pytest.raises(ConfigError, match=r"leader_out\[0\]\.system is 200, that of our own autopilot"):
        parse_config({"autopilot": {"system": 200}, "leader_out": [{"link": "camera"}]})
