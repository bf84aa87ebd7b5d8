"""Records -> MAVLink 2 frames, as the daemon and as simlink's autopilot send them."""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final
from zlib import crc32

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import (
    ActuatorOutputs,
    AdsbVehicle,
    AltitudeType,
    Attitude,
    Battery,
    Collision,
    Command,
    CommandAck,
    GlobalOrigin,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Message,
    Odometry,
    StatusText,
    SystemTime,
    TargetPoints,
    TimeSync,
)
from onboard.messages.mavlink_enums import BODY_FRD
from onboard.wire.mavlink import companion, distance, gimbal, guidance, parameters
from onboard.wire.mavlink.frame import MESSAGES

NUMBERS: Final[dict[str, int]] = {name: number for number, (name, _) in MESSAGES.items()}
STATUSTEXT_LENGTH: Final = 50
ARMED: Final = dialect.MAV_MODE_FLAG_SAFETY_ARMED
LANDED_STATES: Final = {None: 0, True: 1, False: 2}  # MAV_LANDED_STATE
Encode = Mapping[type[Message], Callable[[Any], list[Any]]]


class MavlinkEncoder:
    """Encoder of one sender with its sequence number; `also` extends `ENCODE`."""

    def __init__(self, system: int, component: int, also: Encode | None = None) -> None:
        self._mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._encode = ENCODE if also is None else {**ENCODE, **also}

    def encode(self, message: Message) -> bytes:
        """The frame(s) of one record; TargetPoints makes three LANDING_TARGETs.

        Raises KeyError for a record type that has no MAVLink form.
        """
        return b"".join(self._pack(m) for m in self._encode[type(message)](message))

    def _pack(self, m: Any) -> bytes:
        data: bytes = m.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return data


def message_number(name: str) -> int:
    """The number of a MAVLink message. Raises KeyError for an unknown name."""
    return NUMBERS[name]


def _ms(m: Message) -> int:
    return m.t_ns // 1_000_000 % 2**32


def _usec(m: Message) -> int:
    return m.t_ns // 1000


def _hundredths_of_degree(angle: float | None) -> int:
    return 65535 if angle is None else round(math.degrees(angle) % 360 * 100) % 36000


def _global_position(m: Any) -> list[Any]:
    lat, lon = round(m.lat_deg * 1e7), round(m.lon_deg * 1e7)
    vx, vy, vz = (round(v * 100) for v in m.v_F_n)
    heading = _hundredths_of_degree(m.heading_rad)
    alt, height = round(m.alt_msl * 1000), round(m.height * 1000)
    return [
        dialect.MAVLink_global_position_int_message(_ms(m), lat, lon, alt, height, vx, vy, vz, heading),
    ]


def _global_origin(m: Any) -> list[Any]:
    lat, lon, alt = round(m.lat_deg * 1e7), round(m.lon_deg * 1e7), round(m.alt_msl * 1000)
    return [dialect.MAVLink_gps_global_origin_message(lat, lon, alt, _usec(m))]


def _gps_fix(m: Any) -> list[Any]:
    return [
        dialect.MAVLink_gps_raw_int_message(
            _usec(m),
            m.fix_type,
            round(m.lat_deg * 1e7),
            round(m.lon_deg * 1e7),
            round(m.alt_msl * 1000),
            121,  # a typical HDOP, in hundredths
            65535,
            65535 if m.ground_speed is None else round(m.ground_speed * 100),
            _hundredths_of_degree(m.course_rad),
            255 if m.satellites is None else m.satellites,
            round(m.alt_msl * 1000),
            0 if m.h_acc is None else round(m.h_acc * 1000),
            0 if m.v_acc is None else round(m.v_acc * 1000),
        )
    ]


def _imu(m: Any) -> list[Any]:
    updated = 0b111111  # accelerometer and gyro fields
    altitude = 0.0
    if m.pressure_altitude is not None:
        altitude, updated = m.pressure_altitude, updated | dialect.HIGHRES_IMU_UPDATED_PRESSURE_ALT
    rest = (0.0, 0.0, 0.0, 0.0, 0.0, altitude, 0.0)  # magnetometer, two pressures; temperature
    return [dialect.MAVLink_highres_imu_message(_usec(m), *m.f_b, *m.omega_b, *rest, updated)]


def _target_points(m: Any) -> list[Any]:
    base = 0 if m.target == "leader" else 3 * int(m.target.rsplit("/", 1)[1])
    return [
        dialect.MAVLink_landing_target_message(
            _usec(m), base + label, BODY_FRD, math.atan(y), math.atan(z), 0.0, 0.0, 0.0
        )
        for label, (y, z) in enumerate((m.center, m.left, m.right))
    ]


def _odometry(m: Any) -> list[Any]:
    return [
        dialect.MAVLink_odometry_message(
            _usec(m),
            dialect.MAV_FRAME_LOCAL_NED,
            BODY_FRD,
            *m.r_OF_n,
            m.q_nb,
            *m.v_F_b,
            *m.omega_b,
            m.pose_covariance,
            m.velocity_covariance,
            m.reset_counter,
            dialect.MAV_ESTIMATOR_TYPE_GPS_INS,
            m.quality,
        )
    ]


def _adsb_vehicle(m: Any) -> list[Any]:
    present = {
        dialect.ADSB_FLAGS_VALID_COORDS: m.lat_deg is not None and m.lon_deg is not None,
        dialect.ADSB_FLAGS_VALID_ALTITUDE: m.altitude is not None,
        dialect.ADSB_FLAGS_VALID_HEADING: m.course is not None,
        dialect.ADSB_FLAGS_VALID_VELOCITY: m.ground_speed is not None,
        dialect.ADSB_FLAGS_VERTICAL_VELOCITY_VALID: m.climb is not None,
        dialect.ADSB_FLAGS_VALID_CALLSIGN: bool(m.callsign),
        dialect.ADSB_FLAGS_VALID_SQUAWK: m.squawk is not None,
        dialect.ADSB_FLAGS_SIMULATED: m.simulated,
    }
    geometric = m.altitude_type is AltitudeType.GEOMETRIC
    course = 0 if m.course is None else _hundredths_of_degree(m.course)
    return [
        dialect.MAVLink_adsb_vehicle_message(
            m.icao,
            round((m.lat_deg or 0.0) * 1e7),
            round((m.lon_deg or 0.0) * 1e7),
            dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC if geometric else dialect.ADSB_ALTITUDE_TYPE_PRESSURE_QNH,
            round((m.altitude or 0.0) * 1000),
            course,
            min(round((m.ground_speed or 0.0) * 100), 65535),
            max(min(round((m.climb or 0.0) * 100), 32767), -32768),
            m.callsign.encode("ascii", "replace")[:8],
            m.emitter,
            min(int(m.tslc), 255),
            sum(flag for flag, is_present in present.items() if is_present),
            m.squawk or 0,
        )
    ]


def _collision(m: Any) -> list[Any]:
    none = dialect.MAV_COLLISION_ACTION_NONE  # we report; it is for the autopilot to act
    approach = (m.time, m.vertical, m.horizontal)
    return [dialect.MAVLink_collision_message(m.source, m.threat, none, m.threat_level, *approach)]


def _status_text(m: Any) -> list[Any]:
    """Split a text over several messages, which receivers join by their common id."""
    text = m.text.encode("ascii", "replace")
    chunks = [text[i : i + STATUSTEXT_LENGTH] for i in range(0, len(text), STATUSTEXT_LENGTH)] or [b""]
    number = crc32(text) % 65535 + 1 if len(chunks) > 1 else 0
    return [dialect.MAVLink_statustext_message(m.severity, chunk, number, i) for i, chunk in enumerate(chunks)]


ENCODE: Final[Encode] = {
    Heartbeat: lambda m: [
        dialect.MAVLink_heartbeat_message(
            m.vehicle_type, m.autopilot, ARMED if m.armed else 0, m.custom_mode, m.status, 3
        )
    ],
    SystemTime: lambda m: [dialect.MAVLink_system_time_message(m.unix_ns // 1000, _ms(m))],
    TimeSync: lambda m: [dialect.MAVLink_timesync_message(m.tc1_ns, m.ts1_ns)],
    Attitude: lambda m: [dialect.MAVLink_attitude_quaternion_message(_ms(m), *m.q_nb, *m.omega_b)],
    LocalPosition: lambda m: [dialect.MAVLink_local_position_ned_message(_ms(m), *m.r_OF_n, *m.v_F_n)],
    GlobalPosition: _global_position,
    GlobalOrigin: _global_origin,
    GpsFix: _gps_fix,
    Imu: _imu,
    ActuatorOutputs: lambda m: [
        dialect.MAVLink_servo_output_raw_message(_usec(m) % 2**32, m.port, *m.pwm_us, *[0] * (16 - len(m.pwm_us)))
    ],
    TargetPoints: _target_points,
    Battery: lambda m: [
        dialect.MAVLink_sys_status_message(0, 0, 0, 0, round(m.voltage_v * 1000), -1, -1, *[0] * 6)
    ],
    Command: lambda m: [
        dialect.MAVLink_command_long_message(m.target_system, m.target_component, m.command, 0, *m.params)
    ],
    CommandAck: lambda m: [
        dialect.MAVLink_command_ack_message(m.command, m.result, 0, 0, m.target_system, m.target_component)
    ],
    LandedState: lambda m: [dialect.MAVLink_extended_sys_state_message(0, LANDED_STATES[m.on_ground])],
    StatusText: _status_text,
    AdsbVehicle: _adsb_vehicle,
    Collision: _collision,
    Odometry: _odometry,
    **companion.ENCODE,
    **distance.ENCODE,
    **gimbal.ENCODE,
    **guidance.ENCODE,
    **parameters.ENCODE,
}
