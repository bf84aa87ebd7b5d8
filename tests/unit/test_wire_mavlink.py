"""MAVLink bytes against literal frames, hand-packed ones, and pymavlink's own parser of the common dialect."""

import math
import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Clock,
    Command,
    CommandAck,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
    StatusText,
    SystemTime,
    TargetPoints,
    TimeSync,
)
from onboard.wire.mavlink_decode import MavlinkDecoder
from onboard.wire.mavlink_encode import MavlinkEncoder

RECV = 1_735_689_605_000_000_000
NED_V2 = "fd1c000007030120000040e201000000c03f000010c00000f4c10000003e000000bf000080401edb"
NED_V1 = "fe1c0703012040e201000000c03f000010c00000f4c10000003e000000bf000080406547"


def crc_x25(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        t = byte ^ (crc & 0xFF)
        t ^= (t << 4) & 0xFF
        crc = ((crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4)) & 0xFFFF
    return crc


def frame(
    number: int, extra: int, payload: bytes, *, version: int = 2, system: int = 1, component: int = 1
) -> bytes:
    """A frame packed by hand, after the protocol's own description."""
    if version == 1:
        head = struct.pack("<BBBBB", len(payload), 0, system, component, number)
        magic = b"\xfe"
    else:
        payload = payload.rstrip(b"\0") or b"\0"
        head = struct.pack("<BBBBBB", len(payload), 0, 0, 0, system, component) + number.to_bytes(3, "little")
        magic = b"\xfd"
    return magic + head + payload + struct.pack("<H", crc_x25(head + payload + bytes([extra])))


def decode(data: bytes, *, stream: bool = False) -> list[Message]:
    return MavlinkDecoder(stream=stream).decode(data, RECV)


def one(data: bytes) -> Any:
    (message,) = decode(data)
    return message


def float32(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(np.array(list(values), dtype=np.float32).astype(float).tolist())


# ------------------------------------------------------------------------------ bytes -> records


@pytest.mark.parametrize("literal", [NED_V2, NED_V1], ids=["v2", "v1"])
def test_local_position_from_literal_bytes(literal: str) -> None:
    assert one(bytes.fromhex(literal)) == LocalPosition(
        t_ns=123_456_000_000,
        t_recv_ns=RECV,
        clock=Clock.BOOT,
        system=3,
        component=1,
        r_OF_n=(1.5, -2.25, -30.5),
        v_F_n=(0.125, -0.5, 4.0),
    )


@pytest.mark.parametrize("version", [1, 2])
def test_attitude_quaternion_packed_by_hand(version: int) -> None:
    payload = struct.pack("<I7f", 1000, 0.5, -0.5, 0.5, -0.5, 0.25, -0.125, 2.0)
    m = one(frame(31, 246, payload, version=version))
    assert isinstance(m, Attitude)
    assert m.q_nb == (0.5, -0.5, 0.5, -0.5)
    assert m.omega_b == (0.25, -0.125, 2.0)
    assert m.t_ns == 1_000_000_000


@pytest.mark.parametrize("version", [1, 2])
def test_attitude_in_euler_angles_packed_by_hand(version: int) -> None:
    """A quarter turn of yaw to the east: R_nb takes body x to +y (east)."""
    m = one(frame(30, 39, struct.pack("<I6f", 1000, 0.0, 0.0, math.pi / 2, 0.1, 0.2, 0.3), version=version))
    assert isinstance(m, Attitude)
    assert m.q_nb == pytest.approx((math.sqrt(0.5), 0, 0, math.sqrt(0.5)), abs=1e-7)
    m = one(frame(30, 39, struct.pack("<I6f", 1000, 0.2, 0.0, 0.0, 0, 0, 0), version=version))
    assert m.q_nb == pytest.approx((math.cos(0.1), math.sin(0.1), 0, 0), abs=1e-7)
    m = one(frame(30, 39, struct.pack("<I6f", 1000, 0.0, 0.2, 0.0, 0, 0, 0), version=version))
    assert m.q_nb == pytest.approx((math.cos(0.1), 0, math.sin(0.1), 0), abs=1e-7)


@pytest.mark.parametrize("version", [1, 2])
def test_global_position_packed_by_hand(version: int) -> None:
    payload = struct.pack("<IiiiihhhH", 5000, 501_234_567, -81_234_567, 312_500, -1_250, 1200, -345, -20, 27_000)
    m = one(frame(33, 104, payload, version=version))
    assert isinstance(m, GlobalPosition)
    assert m.lat_deg == pytest.approx(50.1234567, abs=1e-12)
    assert m.lon_deg == pytest.approx(-8.1234567, abs=1e-12)
    assert m.alt_msl == pytest.approx(312.5)
    assert m.height == pytest.approx(-1.25)
    assert m.v_F_n == pytest.approx((12.0, -3.45, -0.20))
    assert m.heading_rad == pytest.approx(1.5 * math.pi)
    unknown = one(frame(33, 104, payload[:-2] + b"\xff\xff", version=version))
    assert unknown.heading_rad is None


def gps(time_usec: int, eph: int = 65535, vel: int = 1234, cog: int = 9000, satellites: int = 14) -> bytes:
    head = struct.pack(
        "<QiiiHHHHBB", time_usec, 501_234_567, 81_234_567, 312_500, eph, 65535, vel, cog, 3, satellites
    )
    return head + struct.pack("<iIIII", 0, 1500, 2500, 0, 0)


def test_gps_stamped_since_boot() -> None:
    m = one(frame(24, 24, gps(7_000_000)))
    assert isinstance(m, GpsFix)
    assert (m.t_ns, m.clock) == (7_000_000_000, Clock.BOOT)
    assert (m.fix_type, m.satellites) == (3, 14)
    assert m.ground_speed == pytest.approx(12.34)
    assert m.course_rad == pytest.approx(math.pi / 2)
    assert (m.h_acc, m.v_acc) == pytest.approx((1.5, 2.5))


def test_gps_stamped_with_unix_time_and_its_unknown_values() -> None:
    m = one(frame(24, 24, gps(1_735_689_605_000_000, vel=65535, cog=65535, satellites=255)))
    assert (m.t_ns, m.clock) == (1_735_689_605_000_000_000, Clock.HOST)
    assert (m.ground_speed, m.course_rad, m.satellites) == (None, None, None)
    v1 = one(frame(24, 24, gps(7_000_000)[:30], version=1))
    assert (v1.h_acc, v1.v_acc) == (None, None), "MAVLink 1 has no accuracies"


def test_messages_without_a_stamp_are_true_when_they_arrived() -> None:
    beat = one(frame(0, 50, struct.pack("<IBBBBB", 4, 2, 12, 0x80 | 0x01, 4, 3)))
    assert beat == Heartbeat(
        t_ns=RECV, t_recv_ns=RECV, clock=Clock.NONE, vehicle_type=2, autopilot=12, armed=True, status=4
    )
    assert not one(frame(0, 50, struct.pack("<IBBBBB", 4, 2, 12, 0x01, 4, 3))).armed
    sync = one(frame(111, 34, struct.pack("<qq", 5_000_000_123, 7_000_000_456)))
    assert isinstance(sync, TimeSync)
    assert (sync.tc1_ns, sync.ts1_ns, sync.clock) == (5_000_000_123, 7_000_000_456, Clock.NONE)
    text = one(frame(253, 83, struct.pack("<B50s", 4, b"Gr\xc3\xbc\xc3\x9fe")))
    assert isinstance(text, StatusText)
    assert text.severity == 4
    assert text.text.startswith("Gr")


def test_imus_in_their_several_units() -> None:
    highres = struct.pack("<Q13fH", 9_000_000, 0.5, -0.25, -9.75, 0.125, 0.0, -1.0, *[0.0] * 7, 63)
    m = one(frame(105, 93, highres))
    assert isinstance(m, Imu)
    assert (m.t_ns, m.f_b, m.omega_b) == (9_000_000_000, (0.5, -0.25, -9.75), (0.125, 0.0, -1.0))
    m = one(frame(26, 170, struct.pack("<I9h", 9000, 100, -200, -1000, 500, -250, 10, 0, 0, 0)))
    assert m.f_b == pytest.approx((0.980665, -1.96133, -9.80665))
    assert m.omega_b == pytest.approx((0.5, -0.25, 0.01))


def test_system_time_servos_and_commands() -> None:
    m = one(frame(2, 137, struct.pack("<QI", 1_735_689_605_123_456, 5000)))
    assert isinstance(m, SystemTime)
    assert (m.unix_ns, m.t_ns) == (1_735_689_605_123_456_000, 5_000_000_000)
    m = one(frame(36, 222, struct.pack("<I8HB8H", 5_000_000, *range(1001, 1009), 0, *[0] * 8)))
    assert isinstance(m, ActuatorOutputs)
    assert m.pwm_us == (*range(1001, 1009), *[0] * 8)
    m = one(frame(76, 152, struct.pack("<7fHBBB", 1, 2, 3, 4, 5, 6, 7, 511, 1, 191, 0), system=255))
    assert isinstance(m, Command)
    assert (m.command, m.target_system, m.target_component, m.system) == (511, 1, 191, 255)
    assert m.params == (1, 2, 3, 4, 5, 6, 7)


# ------------------------------------------------------------------------- records -> other parsers

HEAD = {"t_ns": 5_250_000_000, "t_recv_ns": RECV}
RECORDS: tuple[tuple[Message, str, dict[str, Any]], ...] = (
    (
        Heartbeat(**HEAD, vehicle_type=18, autopilot=8, armed=True, status=4),
        "HEARTBEAT",
        {"type": 18, "autopilot": 8, "base_mode": 128, "system_status": 4, "mavlink_version": 3},
    ),
    (
        SystemTime(**HEAD, unix_ns=1_735_689_605_123_456_000),
        "SYSTEM_TIME",
        {"time_unix_usec": 1_735_689_605_123_456, "time_boot_ms": 5250},
    ),
    (TimeSync(**HEAD, tc1_ns=11, ts1_ns=-12), "TIMESYNC", {"tc1": 11, "ts1": -12}),
    (
        Attitude(**HEAD, q_nb=(0.5, -0.5, 0.5, -0.5), omega_b=(0.25, -0.5, 1.0)),
        "ATTITUDE_QUATERNION",
        {"q1": 0.5, "q2": -0.5, "q3": 0.5, "q4": -0.5, "rollspeed": 0.25, "pitchspeed": -0.5, "yawspeed": 1.0},
    ),
    (
        LocalPosition(**HEAD, r_OF_n=(1.5, -2.5, -30.0), v_F_n=(-1.0, 0.5, 0.25)),
        "LOCAL_POSITION_NED",
        {"time_boot_ms": 5250, "x": 1.5, "y": -2.5, "z": -30.0, "vx": -1.0, "vy": 0.5, "vz": 0.25},
    ),
    (
        GlobalPosition(
            **HEAD, lat_deg=-50.1234567, lon_deg=8.5, alt_msl=312.5, height=-1.25,
            v_F_n=(1, -2, 3), heading_rad=-0.1,
        ),
        "GLOBAL_POSITION_INT",
        {
            "lat": -501_234_567, "lon": 85_000_000, "alt": 312_500, "relative_alt": -1250,
            "vx": 100, "vy": -200, "vz": 300, "hdg": round((360 - math.degrees(0.1)) * 100),
        },
    ),
    (
        GpsFix(
            **HEAD, fix_type=3, satellites=None, lat_deg=50, lon_deg=-8, alt_msl=100, ground_speed=None,
            course_rad=None, h_acc=1.5, v_acc=None,
        ),
        "GPS_RAW_INT",
        {
            "time_usec": 5_250_000, "lat": 500_000_000, "lon": -80_000_000, "alt": 100_000, "vel": 65535,
            "cog": 65535, "satellites_visible": 255, "h_acc": 1500, "v_acc": 0,
        },
    ),
    (
        Imu(**HEAD, f_b=(0.5, -0.25, -9.75), omega_b=(0.125, 0.0, -1.0)),
        "HIGHRES_IMU",
        {"time_usec": 5_250_000, "xacc": 0.5, "yacc": -0.25, "zacc": -9.75, "xgyro": 0.125, "zgyro": -1.0,
         "pressure_alt": 0.0, "fields_updated": 0b111111},
    ),
    (
        Imu(**HEAD, f_b=(0.5, -0.25, -9.75), omega_b=(0.125, 0.0, -1.0), pressure_altitude=512.5),
        "HIGHRES_IMU",
        {"time_usec": 5_250_000, "zacc": -9.75, "pressure_alt": 512.5, "fields_updated": 0b100000111111},
    ),
    (
        ActuatorOutputs(**HEAD, pwm_us=(1100, 1900)),
        "SERVO_OUTPUT_RAW",
        {"servo1_raw": 1100, "servo2_raw": 1900, "servo16_raw": 0},
    ),
    (
        Command(**HEAD, target_system=1, target_component=1, command=511, params=(32, 20000, 0, 0, 0, 0, 0)),
        "COMMAND_LONG",
        {"command": 511, "param1": 32.0, "param2": 20000.0, "target_system": 1, "target_component": 1},
    ),
    (
        CommandAck(**HEAD, target_system=255, target_component=190, command=512, result=3),
        "COMMAND_ACK",
        {"command": 512, "result": 3, "target_system": 255, "target_component": 190},
    ),
    (StatusText(**HEAD, severity=6, text="tracking"), "STATUSTEXT", {"severity": 6, "text": "tracking"}),
)  # fmt: skip


def independent(data: bytes) -> list[Any]:
    parser = common.MAVLink(None)
    return parser.parse_buffer(data) or []


@pytest.mark.parametrize(("record", "name", "fields"), RECORDS, ids=[name for _, name, _ in RECORDS])
def test_what_is_encoded_an_independent_parser_reads(record: Message, name: str, fields: dict[str, Any]) -> None:
    (m,) = independent(MavlinkEncoder(7, 191).encode(record))
    assert (m.get_type(), m.get_srcSystem(), m.get_srcComponent()) == (name, 7, 191)
    assert {k: getattr(m, k) for k in fields} == pytest.approx(fields)


@pytest.mark.parametrize(("press_abs", "altitude"), [(1013.25, 0.0), (898.746, 1000.0), (1037.51, -200.0)])
def test_a_pressure_is_an_altitude_of_the_standard_atmosphere(press_abs: float, altitude: float) -> None:
    """Pressures from the standard's table (ISO 2533)."""
    m = one(frame(29, 115, struct.pack("<Iffh", 5250, press_abs, 0.0, 2500)))
    assert isinstance(m, Barometer)
    assert (m.t_ns, m.clock) == (5_250_000_000, Clock.BOOT)
    assert m.pressure_altitude == pytest.approx(altitude, abs=0.05)


@pytest.mark.parametrize("press_abs", [0.0, -1.0, math.nan])
def test_no_pressure_is_no_altitude(press_abs: float) -> None:
    m = one(frame(29, 115, struct.pack("<Iffh", 5250, press_abs, 0.0, 2500)))
    assert math.isnan(m.pressure_altitude)


@pytest.mark.parametrize(("record", "name", "fields"), RECORDS, ids=[name for _, name, _ in RECORDS])
def test_what_is_encoded_comes_back(record: Message, name: str, fields: dict[str, Any]) -> None:
    del name, fields
    back = one(MavlinkEncoder(record.system, record.component).encode(record))
    assert type(back) is type(record)
    for field in set(record.__struct_fields__) - {"t_ns", "clock", "heading_rad", "pwm_us"}:
        assert getattr(back, field) == pytest.approx(getattr(record, field)), field


def test_image_points_leave_as_three_landing_targets_of_one_time() -> None:
    image = TargetPoints(**HEAD, camera="c", center=(0.1, -0.2), left=(0.0, -0.3), right=(0.2, -0.1))
    frames = independent(MavlinkEncoder(1, 191).encode(image))
    assert [m.target_num for m in frames] == [0, 1, 2]
    assert {m.time_usec for m in frames} == {5_250_000}
    assert {m.frame for m in frames} == {12}
    assert {m.position_valid for m in frames} == {0}
    assert [m.angle_x for m in frames] == pytest.approx([math.atan(0.1), 0.0, math.atan(0.2)])
    assert [m.angle_y for m in frames] == pytest.approx([math.atan(-0.2), math.atan(-0.3), math.atan(-0.1)])


def test_the_sequence_number_counts_every_frame() -> None:
    encoder = MavlinkEncoder(1, 191)
    data = b"".join(encoder.encode(RECORDS[0][0]) for _ in range(300))
    assert [m.get_seq() for m in independent(data)] == [i % 256 for i in range(300)]


# --------------------------------------------------------------------------------- LANDING_TARGET


def landing(number: int, x: float, y: float, t_us: int = 5_000_000, component: int = 191) -> bytes:
    head = struct.pack("<Q5fBB", t_us, x, y, 0.0, 0.0, 0.0, number, 12)
    return frame(149, 200, head, component=component)


def labelled(t_us: int = 5_000_000, base: int = 0) -> list[bytes]:
    angles = ((0.1, -0.2), (0.05, -0.25), (0.15, -0.15))
    return [landing(base + k, *angle, t_us=t_us) for k, angle in enumerate(angles)]


def points_of(m: Any) -> tuple[float, ...]:
    return (*m.center, *m.left, *m.right)


EXPECTED = tuple(math.tan(a) for a in (0.1, -0.2, 0.05, -0.25, 0.15, -0.15))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (2, 0, 1)], ids=str)
def test_three_targets_in_any_order_are_one_image(order: tuple[int, ...]) -> None:
    frames = labelled()
    m = one(b"".join(frames[i] for i in order))
    assert isinstance(m, TargetPoints)
    assert points_of(m) == pytest.approx(EXPECTED, abs=1e-7)
    assert (m.t_ns, m.clock, m.target, m.component) == (5_000_000_000, Clock.BOOT, "leader", 191)


def test_two_images_interleaved_over_datagrams_are_two() -> None:
    decoder = MavlinkDecoder(stream=False)
    a, b = labelled(5_000_000), labelled(5_040_000)
    found = [m for f in (a[0], b[0], b[1], a[1], a[2], b[2]) for m in decoder.decode(f, RECV)]
    assert [m.t_ns for m in found] == [5_000_000_000, 5_040_000_000]
    assert not decoder.rejected


def test_images_of_two_cameras_at_one_time_are_not_mixed() -> None:
    decoder = MavlinkDecoder(stream=False)
    frames = [landing(k, 0.1 * c, 0.0, component=c) for k in range(3) for c in (100, 101)]
    found = [m for f in frames for m in decoder.decode(f, RECV)]
    assert [m.component for m in found] == [100, 101]


def test_a_missing_third_point_costs_that_image_only_and_is_counted() -> None:
    decoder = MavlinkDecoder(stream=False)
    found = 0
    for i in range(100):
        frames = labelled(5_000_000 + 40_000 * i)
        for f in frames if i % 2 else frames[:2]:
            found += len(decoder.decode(f, RECV))
    assert found == 50
    assert decoder.rejected["incomplete_points"] >= 50 - 8
    assert len(decoder._points._pending) <= 8


def test_target_numbers_from_three_on_are_another_target() -> None:
    m = one(b"".join(labelled(base=3)))
    assert m.target == "target/1"
    assert points_of(m) == pytest.approx(EXPECTED, abs=1e-7)
    both = decode(b"".join([labelled()[0], labelled(base=3)[0], *labelled()[1:], *labelled(base=3)[1:]]))
    assert [m.target for m in both if isinstance(m, TargetPoints)] == ["leader", "target/1"]
    encoded = MavlinkEncoder(1, 191).encode(m)
    assert [f.target_num for f in independent(encoded)] == [3, 4, 5]


@pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf, math.pi / 2, -math.pi / 2, 3.0, 1e30])
def test_angles_no_image_point_has_become_nan_not_a_number_that_looks_like_one(angle: float) -> None:
    m = one(landing(0, angle, 0.1) + b"".join(labelled()[1:]))
    assert math.isnan(m.center[0])
    assert m.center[1] == pytest.approx(math.tan(0.1))


def test_an_image_with_no_stamp_says_so() -> None:
    m = one(b"".join(landing(k, 0.1, 0.1, t_us=0) for k in range(3)))
    assert m.clock is Clock.NONE


def test_an_image_stamped_with_unix_time_is_on_the_host_clock() -> None:
    m = one(b"".join(labelled(1_735_689_605_000_000)))
    assert m.clock is Clock.HOST


# ------------------------------------------------------------------------------ framing and damage


def flight_bytes(n: int = 40) -> tuple[bytes, list[Message]]:
    encoder = MavlinkEncoder(1, 1)
    data = b"".join(encoder.encode(RECORDS[i % len(RECORDS)][0]) for i in range(n))
    return data, decode(data)


def test_a_stream_cut_at_every_byte_gives_the_same_messages() -> None:
    data, whole = flight_bytes()
    assert len(whole) == 40
    for cut in range(len(data)):
        decoder = MavlinkDecoder(stream=True)
        assert decoder.decode(data[:cut], RECV) + decoder.decode(data[cut:], RECV) == whole
    decoder = MavlinkDecoder(stream=True)
    assert [m for i in range(len(data)) for m in decoder.decode(data[i : i + 1], RECV)] == whole
    assert not decoder.rejected


def test_the_buffer_of_a_stream_whose_reads_end_mid_frame_stays_small() -> None:
    decoder = MavlinkDecoder(stream=True)
    unit = bytes.fromhex(NED_V2)
    data = unit * 3
    largest = found = 0
    for _ in range(100_000):  # always the tail of one frame and the head of the next
        found += len(decoder.decode(data[20 : 20 + len(unit)], RECV))
        largest = max(largest, len(decoder._parser.buf))
    assert found >= 99_999
    assert largest < 8192


def test_a_truncated_datagram_does_not_eat_the_next() -> None:
    unit = bytes.fromhex(NED_V2)
    for length in range(1, len(unit)):
        decoder = MavlinkDecoder(stream=False)
        assert decoder.decode(unit[:length], RECV) == []
        assert len(decoder.decode(unit, RECV)) == 1, f"eaten after {length} bytes"
        assert decoder.rejected["truncated"] == 1


def test_a_false_start_in_a_stream_costs_little() -> None:
    data = bytes.fromhex(NED_V2)
    decoder = MavlinkDecoder(stream=True)
    found = decoder.decode(b"\x00\x11\x22" + data[:9] + data * 20, RECV)
    assert len(found) >= 18
    assert decoder.rejected["bad_frame"] >= 1


def test_one_wrong_bit_anywhere_rejects_the_frame_and_is_counted() -> None:
    data = bytes.fromhex(NED_V2)
    for bit in range(8, 8 * len(data)):
        if bit // 8 in (2, 3):  # flags: of signing and compatibility, tested on their own
            continue
        wrong = bytearray(data)
        wrong[bit // 8] ^= 1 << bit % 8
        decoder = MavlinkDecoder(stream=False)
        assert decoder.decode(bytes(wrong), RECV) == []
        assert sum(decoder.rejected.values()) >= 1


def test_a_bad_checksum_is_counted_and_the_next_frame_of_the_datagram_read() -> None:
    data = bytes.fromhex(NED_V2)
    decoder = MavlinkDecoder(stream=False)
    assert len(decoder.decode(data[:-1] + b"\x00" + data, RECV)) == 1
    assert decoder.rejected == {"bad_frame": 1}


def test_unknown_messages_are_counted_and_do_no_harm() -> None:
    decoder = MavlinkDecoder(stream=False)
    unknown = frame(60_001, 17, b"\x01\x02\x03")
    assert len(decoder.decode(unknown + bytes.fromhex(NED_V2), RECV)) == 1
    assert decoder.rejected == {"unknown_message": 1}
    assert decoder.names == {"LOCAL_POSITION_NED": 1}


def test_known_messages_we_do_not_use_are_counted_by_name() -> None:
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    decoder = MavlinkDecoder(stream=False)
    assert decoder.decode(sender.param_value_encode(b"RATE", 1.0, 9, 1, 0).pack(sender), RECV) == []
    assert decoder.names == {"PARAM_VALUE": 1}
    assert not decoder.rejected


def test_signed_frames_are_read() -> None:
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.signing.secret_key = b"k" * 32
    sender.signing.sign_outgoing = True
    sender.signing.link_id = 1
    sender.signing.timestamp = 1
    data = sender.local_position_ned_encode(123456, 1.5, -2.25, -30.5, 0.125, -0.5, 4.0).pack(sender)
    assert data[2] == 1
    decoder = MavlinkDecoder(stream=False)
    assert len(decoder.decode(data + data, RECV)) == 2


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.binary(max_size=400), max_size=6), st.booleans())
def test_random_bytes_never_raise(chunks: list[bytes], stream: bool) -> None:
    decoder = MavlinkDecoder(stream=stream)
    for chunk in chunks:
        decoder.decode(chunk, RECV)


NUMBERS = sorted(common.mavlink_map)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.sampled_from(NUMBERS), st.binary(max_size=255), st.booleans(), st.sampled_from([1, 2]))
def test_random_payloads_of_real_messages_with_good_checksums_never_raise(
    number: int, payload: bytes, stream: bool, version: int
) -> None:
    if version == 1 and number > 255:
        return
    extra = common.mavlink_map[number].crc_extra
    decoder = MavlinkDecoder(stream=stream)
    decoder.decode(frame(number, extra, payload, version=version) + bytes.fromhex(NED_V2), RECV)


def test_random_payloads_of_every_message_we_convert_with_seed_8() -> None:
    rng = np.random.default_rng(8)
    for number, kind in common.mavlink_map.items():
        for _ in range(20):
            size = kind.unpacker.size
            payload = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
            decoder = MavlinkDecoder(stream=False)
            decoder.decode(frame(number, kind.crc_extra, payload), RECV)
            assert sum(decoder.names.values()) + decoder.rejected["unknown_message"] == 1
