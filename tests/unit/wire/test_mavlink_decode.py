"""Records from MAVLink bytes: literal frames and hand-packed ones."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Clock,
    Command,
    CurrentMode,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    ParamValue,
    StatusText,
    SystemTime,
    TimeSync,
)
from onboard.wire.mavlink.decode import MavlinkDecoder
from tests.support.mavlink_frames import NED_V1, NED_V2, RECEIVE_TIME_NS, frame, one


@pytest.mark.parametrize("literal", [NED_V2, NED_V1], ids=["v2", "v1"])
def test_local_position_from_literal_bytes(literal: str) -> None:
    assert one(bytes.fromhex(literal)) == LocalPosition(
        t_ns=123_456_000_000,
        t_recv_ns=RECEIVE_TIME_NS,
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
        t_ns=RECEIVE_TIME_NS,
        t_recv_ns=RECEIVE_TIME_NS,
        clock=Clock.NONE,
        vehicle_type=2,
        autopilot=12,
        armed=True,
        status=4,
        custom_mode=4,
    )
    assert not one(frame(0, 50, struct.pack("<IBBBBB", 4, 2, 12, 0x01, 4, 3))).armed
    sync = one(frame(111, 34, struct.pack("<qq", 5_000_000_123, 7_000_000_456)))
    assert isinstance(sync, TimeSync)
    assert (sync.tc1_ns, sync.ts1_ns, sync.clock) == (5_000_000_123, 7_000_000_456, Clock.NONE)
    text = one(frame(253, 83, struct.pack("<B50s", 4, b"Gr\xc3\xbc\xc3\x9fe")))
    assert isinstance(text, StatusText)
    assert text.severity == 4
    assert text.text.startswith("Gr")


def test_the_mode_that_px4_returns_to() -> None:
    m = one(frame(436, 193, struct.pack("<2IB", 4 << 16 | 3 << 24, 6 << 16, 0)))
    assert isinstance(m, CurrentMode)
    assert (m.custom_mode, m.intended_mode) == (4 << 16 | 3 << 24, 6 << 16)


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


ISA = {  # the standard's printed table (ISO 2533): geopotential altitude, m: pressure, hPa
    -1000: 1139.29,
    -200: 1037.51,
    0: 1013.25,
    500: 954.608,
    1000: 898.746,
    2000: 794.952,
    3000: 701.085,
    4000: 616.402,
    5000: 540.199,
    6000: 471.810,
    8000: 355.998,
    10000: 264.363,
    11000: 226.321,
}


@pytest.mark.parametrize(("altitude", "press_abs"), ISA.items())
def test_a_pressure_is_an_altitude_of_the_standard_atmosphere(press_abs: float, altitude: float) -> None:
    m = one(frame(29, 115, struct.pack("<Iffh", 5250, press_abs, 0.0, 2500)))
    assert isinstance(m, Barometer)
    assert (m.t_ns, m.clock) == (5_250_000_000, Clock.BOOT)
    assert m.pressure_altitude == pytest.approx(altitude, abs=0.05)


@pytest.mark.parametrize("press_abs", [0.0, -1.0, math.nan])
def test_no_pressure_is_no_altitude(press_abs: float) -> None:
    m = one(frame(29, 115, struct.pack("<Iffh", 5250, press_abs, 0.0, 2500)))
    assert math.isnan(m.pressure_altitude)


def test_outputs_have_their_port() -> None:
    """SERVO_OUTPUT_RAW says by `port` which outputs it holds: motors may be on any (`own_state.faults`)."""
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    decoder = MavlinkDecoder(stream=False)
    outputs = []
    for port, pwm in ((0, 1700), (1, 1100), (0, 1701), (2, 900)):
        frame = dialect.MAVLink_servo_output_raw_message(1000, port, *[pwm] * 16)
        outputs += decoder.decode(frame.pack(sender), 5)
    found = [(m.port, m.pwm_us[0]) for m in outputs if isinstance(m, ActuatorOutputs)]
    assert found == [(0, 1700), (1, 1100), (0, 1701), (2, 900)]
    assert not decoder.rejected


@pytest.mark.parametrize(
    ("kind", "sent", "value"),
    [
        (9, struct.pack("<f", 0.125), 0.125),
        (6, struct.pack("<f", -3.0), -3.0),  # as ArduPilot sends it
        *((6, struct.pack("<i", n), n) for n in (0, 1, -1, 57600, -70000)),  # as PX4 does
        (5, struct.pack("<I", 4), 4),
        (2, struct.pack("<b3x", -5), -5),
        (4, struct.pack("<h2x", -500), -500),
    ],
)
def test_a_parameter_s_value_is_that_of_its_type(kind: int, sent: bytes, value: float) -> None:
    m = one(frame(22, 220, sent + struct.pack("<2H16sB", 900, 12, b"SER_TEL1_BAUD", kind)))
    assert isinstance(m, ParamValue)
    assert (m.name, m.value, m.count, m.index, m.default) == ("SER_TEL1_BAUD", value, 900, 12, None)
