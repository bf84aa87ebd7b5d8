"""A record of each encoded kind, with the MAVLink name and fields that a parser must find."""

import math
from typing import Any, Final

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Command,
    CommandAck,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Message,
    Setpoint,
    StatusText,
    SystemTime,
    TimeSync,
)
from tests.support.mavlink_frames import RECEIVE_TIME_NS

HEAD: Final = {"t_ns": 5_250_000_000, "t_recv_ns": RECEIVE_TIME_NS}
RECORDS: Final[tuple[tuple[Message, str, dict[str, Any]], ...]] = (
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
    (LandedState(**HEAD, on_ground=False), "EXTENDED_SYS_STATE", {"landed_state": 2}),
    (
        Setpoint(
            **HEAD, target_system=1, target_component=1, r_OF_n=(1.5, -2.5, -30.0), v_F_n=(1.0, 0.5, -0.25),
            a_F_n=(0.25, 0.5, -1.0), yaw=1.25, yaw_rate=-0.5,
        ),
        "SET_POSITION_TARGET_LOCAL_NED",
        {"time_boot_ms": 5250, "type_mask": 0, "coordinate_frame": 1, "z": -30.0, "afy": 0.5, "yaw_rate": -0.5},
    ),
    (StatusText(**HEAD, severity=6, text="tracking"), "STATUSTEXT", {"severity": 6, "text": "tracking"}),
)  # fmt: skip
