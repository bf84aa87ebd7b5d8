"""Payloads of MAVLink messages -> records in SI units, by a layout and a function each.

Fields are in the order of the wire: the largest types first, extensions last. A payload that is shorter than its
layout ends in zeros that MAVLink 2 omits, or in extensions that its sender does not know; both are read as zeros.
"""

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import (
    ActuatorOutputs,
    AdsbVehicle,
    AltitudeType,
    Attitude,
    Barometer,
    Battery,
    Clock,
    Collision,
    Command,
    CommandAck,
    CurrentMode,
    EstimatorStatus,
    GlobalOrigin,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Message,
    StatusText,
    SystemTime,
    TimeSync,
)
from onboard.wire.mavlink import distance, gimbal, guidance, parameters

ATTITUDE_VARIANCES: Final = (29, 32, 34)  # in ODOMETRY, of the pose's covariance: roll, pitch, yaw
MAX_YAW_VARIANCE: Final = math.pi**2  # rad^2, of a uniform direction or more

# MAV_LANDED_STATE: on the ground, in the air, taking off, landing
ON_GROUND: Final = {1: True, 2: False, 3: True, 4: False}
NO_VOLTAGE: Final = (0, 65535)  # mV: nobody measures it, or there is no such cell
GRAVITY: Final = 9.80665
SEA_LEVEL_PRESSURE_HPA: Final = 1013.25
SEA_LEVEL_TEMPERATURE_K: Final = 288.15
LAPSE_RATE_K_M: Final = 0.0065
LAPSE_EXPONENT: Final = 0.190263
MIN_UNIX_TIME_NS: Final = 10**18  # a larger 64-bit stamp (2001) is Unix time, a smaller one time since boot

Fields = tuple[Any, ...]
Header = dict[str, Any]
Convert = Callable[[Fields, Header], Message | None]


class Layout:
    """The `struct` format of a message; `boot_ms` or `usec` is the index of its time field."""

    def __init__(self, form: str, *, boot_ms: int | None = None, usec: int | None = None) -> None:
        self.form = form
        self._unpack = struct.Struct(form).unpack_from
        self._size = struct.calcsize(form)
        self._boot_ms, self._usec = boot_ms, usec

    def fields(self, payload: bytes) -> Fields:
        """The fields of a payload of any length."""
        return self._unpack(payload.ljust(self._size, b"\0"))

    def header(self, fields: Fields, t_recv_ns: int, system: int, component: int) -> Header:
        """Fields that every record has; a message without a time field is stamped on arrival."""
        t_ns, clock = t_recv_ns, Clock.NONE
        if self._boot_ms is not None:
            t_ns, clock = fields[self._boot_ms] * 1_000_000, Clock.BOOT
        elif self._usec is not None and fields[self._usec] > 0:
            t_ns = fields[self._usec] * 1000
            clock = Clock.HOST if t_ns >= MIN_UNIX_TIME_NS else Clock.BOOT
        return {"t_ns": t_ns, "t_recv_ns": t_recv_ns, "clock": clock, "system": system, "component": component}


def _known(value: float, unknown: float, scale: float) -> float | None:
    """A scaled field, None where it holds the number that stands for "unknown"."""
    return None if value == unknown else value * scale


def _heartbeat(f: Fields, h: Header) -> Message:
    custom_mode, vehicle_type, autopilot, base_mode, status, _ = f
    return Heartbeat(
        **h,
        vehicle_type=vehicle_type,
        autopilot=autopilot,
        armed=bool(base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED),
        status=status,
        custom_mode=custom_mode,
    )


def _attitude(f: Fields, h: Header) -> Message:
    _, roll, pitch, yaw, *rates = f
    w, x, y, z = quaternion_from_euler(roll, pitch, yaw).tolist()
    return Attitude(**h, q_nb=(w, x, y, z), omega_b=tuple(rates))


def _global_position(f: Fields, h: Header) -> Message:
    _, lat, lon, alt, height, vx, vy, vz, heading = f
    return GlobalPosition(
        **h,
        lat_deg=lat * 1e-7,
        lon_deg=lon * 1e-7,
        alt_msl=alt * 1e-3,
        height=height * 1e-3,
        v_F_n=(vx * 0.01, vy * 0.01, vz * 0.01),
        heading_rad=_known(heading, 65535, math.pi / 18000),
    )


def _estimator_status(flags: int, ratios: Sequence[float], h: Header, *, is_px4: bool = False) -> Message:
    """The record of the flags of EKF_STATUS_REPORT or ESTIMATOR_STATUS, which have equal bits.

    A report of zeros only was not filled in. PX4 also sets constant-position mode at rest, where the velocity is
    known.
    """
    if flags == 0 and not any(ratios):
        return EstimatorStatus(**h, horizontal_velocity=None, horizontal_position=None)
    fixed = bool(flags & dialect.ESTIMATOR_CONST_POS_MODE)
    unknown = fixed and not is_px4
    return EstimatorStatus(
        **h,
        horizontal_velocity=bool(flags & dialect.ESTIMATOR_VELOCITY_HORIZ) and not unknown,
        horizontal_position=bool(flags & (dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS))
        and not unknown,
        is_at_rest=fixed and is_px4,
    )


def _odometry(f: Fields, h: Header) -> Message:
    """The autopilot's attitude sigmas and resets; variances of 0 and NaN are unknown."""
    roll, pitch, yaw = (f[i] for i in ATTITUDE_VARIANCES)
    is_known = all(0.0 < variance < math.inf for variance in (roll, pitch, yaw))
    return EstimatorStatus(
        **h,
        horizontal_velocity=None,
        horizontal_position=None,
        yaw_sigma=math.sqrt(min(yaw, MAX_YAW_VARIANCE)) if is_known else None,
        tilt_sigma=math.sqrt(min(max(roll, pitch), MAX_YAW_VARIANCE)) if is_known else None,
        resets=f[58],
    )


def _global_origin(f: Fields, h: Header) -> Message:
    lat, lon, alt, _ = f
    return GlobalOrigin(**h, lat_deg=lat * 1e-7, lon_deg=lon * 1e-7, alt_msl=alt * 1e-3)


def _gps_fix(f: Fields, h: Header) -> Message:
    _, lat, lon, alt, _, _, vel, cog, fix_type, satellites, _, h_acc, v_acc, *_ = f
    return GpsFix(
        **h,
        fix_type=fix_type,
        satellites=None if satellites == 255 else satellites,
        lat_deg=lat * 1e-7,
        lon_deg=lon * 1e-7,
        alt_msl=alt * 1e-3,
        ground_speed=_known(vel, 65535, 0.01),
        course_rad=_known(cog, 65535, math.pi / 18000),
        h_acc=_known(h_acc, 0, 1e-3),
        v_acc=_known(v_acc, 0, 1e-3),
    )


def _highres_imu(f: Fields, h: Header) -> Message:
    *_, pressure_alt, _, fields_updated, _ = f
    altitude = pressure_alt if fields_updated & dialect.HIGHRES_IMU_UPDATED_PRESSURE_ALT else None
    return Imu(**h, f_b=f[1:4], omega_b=f[4:7], pressure_altitude=altitude)


def barometer(h: Header, pressure_hpa: float) -> Barometer:
    """Pressure altitude (ISO 2533); NaN unless the pressure is positive."""
    ratio = pressure_hpa / SEA_LEVEL_PRESSURE_HPA
    altitude = (
        (1.0 - ratio**LAPSE_EXPONENT) * SEA_LEVEL_TEMPERATURE_K / LAPSE_RATE_K_M if ratio > 0.0 else math.nan
    )
    return Barometer(**h, pressure_altitude=altitude)


def _scaled_imu(f: Fields, h: Header) -> Message:
    milli_g, milli = GRAVITY * 1e-3, 1e-3
    _, ax, ay, az, wx, wy, wz, *_ = f
    f_b = (ax * milli_g, ay * milli_g, az * milli_g)
    return Imu(**h, f_b=f_b, omega_b=(wx * milli, wy * milli, wz * milli))


def _battery(millivolts: int, h: Header) -> Message | None:
    return None if millivolts in NO_VOLTAGE else Battery(**h, voltage_v=millivolts * 1e-3)


def _battery_status(f: Fields, h: Header) -> Message | None:
    """The first battery's voltage; other batteries may drive no motor."""
    cells = [mv for mv in (*f[3:13], *f[20:24]) if mv not in NO_VOLTAGE]
    return _battery(sum(cells), h) if f[14] == 0 else None


def _command_long(f: Fields, h: Header) -> Message:
    command, system, component, _ = f[7:]
    return Command(**h, target_system=system, target_component=component, command=command, params=f[:7])


def _command_int(f: Fields, h: Header) -> Message:
    p1, p2, p3, p4, x, y, z, command, system, component, *_ = f
    params = (p1, p2, p3, p4, float(x), float(y), z)
    return Command(**h, target_system=system, target_component=component, command=command, params=params)


def _command_ack(f: Fields, h: Header) -> Message:
    command, result, _, _, system, component = f
    return CommandAck(**h, target_system=system, target_component=component, command=command, result=result)


def _status_text(f: Fields, h: Header) -> Message:
    severity, text, *_ = f
    return StatusText(**h, severity=severity, text=text.split(b"\0", 1)[0].decode("ascii", "replace"))


def _adsb_vehicle(f: Fields, h: Header) -> Message:
    """A field whose flag is not set is unknown."""
    icao, lat, lon, altitude, heading, speed, climb, flags, squawk, kind, callsign, emitter, tslc = f

    def has(flag: int) -> bool:
        return bool(flags & flag)

    is_geometric = kind == dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC
    return AdsbVehicle(
        **h,
        icao=icao,
        lat_deg=lat * 1e-7 if has(dialect.ADSB_FLAGS_VALID_COORDS) else None,
        lon_deg=lon * 1e-7 if has(dialect.ADSB_FLAGS_VALID_COORDS) else None,
        altitude=altitude * 1e-3 if has(dialect.ADSB_FLAGS_VALID_ALTITUDE) else None,
        altitude_type=AltitudeType.GEOMETRIC if is_geometric else AltitudeType.PRESSURE,
        course=heading * math.pi / 18000 if has(dialect.ADSB_FLAGS_VALID_HEADING) else None,
        ground_speed=speed * 0.01 if has(dialect.ADSB_FLAGS_VALID_VELOCITY) else None,
        climb=climb * 0.01 if has(dialect.ADSB_FLAGS_VERTICAL_VELOCITY_VALID) else None,
        callsign=_text(callsign) if has(dialect.ADSB_FLAGS_VALID_CALLSIGN) else "",
        emitter=emitter,
        tslc=float(tslc),
        squawk=squawk if has(dialect.ADSB_FLAGS_VALID_SQUAWK) else None,
        simulated=has(dialect.ADSB_FLAGS_SIMULATED),
    )


def _text(field: bytes) -> str:
    """A character field up to its first NUL, printable ASCII only."""
    text = field.split(b"\0", 1)[0].decode("ascii", "replace")
    return "".join(c for c in text if c.isascii() and c.isprintable()).strip()


def _collision(f: Fields, h: Header) -> Message:
    threat, time, vertical, horizontal, source, _, level = f
    return Collision(
        **h, source=source, threat=threat, threat_level=level, time=time, vertical=vertical, horizontal=horizontal
    )


CONVERT: Final[dict[str, tuple[Layout, Convert]]] = {
    "HEARTBEAT": (Layout("<I5B"), _heartbeat),
    "SYSTEM_TIME": (Layout("<QI", boot_ms=1), lambda f, h: SystemTime(**h, unix_ns=f[0] * 1000)),
    "TIMESYNC": (Layout("<2q"), lambda f, h: TimeSync(**h, tc1_ns=f[0], ts1_ns=f[1])),
    "ATTITUDE_QUATERNION": (
        Layout("<I11f", boot_ms=0),
        lambda f, h: Attitude(**h, q_nb=f[1:5], omega_b=f[5:8]),
    ),
    "ATTITUDE": (Layout("<I6f", boot_ms=0), _attitude),
    "LOCAL_POSITION_NED": (
        Layout("<I6f", boot_ms=0),
        lambda f, h: LocalPosition(**h, r_OF_n=f[1:4], v_F_n=f[4:7]),
    ),
    "GLOBAL_POSITION_INT": (Layout("<I4i3hH", boot_ms=0), _global_position),
    "EKF_STATUS_REPORT": (Layout("<5fHf"), lambda f, h: _estimator_status(f[5], f[:5], h)),
    "ESTIMATOR_STATUS": (
        Layout("<Q8fH", usec=0),
        lambda f, h: _estimator_status(f[9], f[1:9], h, is_px4=True),
    ),
    "ODOMETRY": (Layout("<Q55f4Bb", usec=0), _odometry),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": (Layout(gimbal.FORM, boot_ms=0), gimbal.attitude),
    "MOUNT_ORIENTATION": (Layout(gimbal.ORIENTATION, boot_ms=0), gimbal.orientation),
    "DISTANCE_SENSOR": (Layout(distance.FORM), distance.reading),
    "GPS_GLOBAL_ORIGIN": (Layout("<3iQ", usec=3), _global_origin),
    "GPS_RAW_INT": (Layout("<Q3i4H2Bi4IH", usec=0), _gps_fix),
    "HIGHRES_IMU": (Layout("<Q13fHB", usec=0), _highres_imu),
    "SCALED_IMU": (Layout("<I10h", boot_ms=0), _scaled_imu),
    "RAW_IMU": (Layout("<Q9hBh", usec=0), _scaled_imu),
    "SCALED_PRESSURE": (Layout("<I2f2h", boot_ms=0), lambda f, h: barometer(h, f[1])),
    "SERVO_OUTPUT_RAW": (
        Layout("<I8HB8H", usec=0),
        lambda f, h: ActuatorOutputs(**h, pwm_us=f[1:9] + f[10:18], port=f[9]),
    ),
    "SYS_STATUS": (Layout("<3I2Hh6Hb3I"), lambda f, h: _battery(f[4], h)),
    "BATTERY_STATUS": (Layout("<2ih10Hh3BbiB4HBI"), _battery_status),
    "COMMAND_LONG": (Layout("<7fH3B"), _command_long),
    "COMMAND_INT": (Layout("<4f2ifH5B"), _command_int),
    "COMMAND_ACK": (Layout("<H2Bi2B"), _command_ack),
    "STATUSTEXT": (Layout("<B50sHB"), _status_text),
    "ADSB_VEHICLE": (Layout("<I3i2Hh2HB9s2B"), _adsb_vehicle),
    "COLLISION": (Layout("<I3f3B"), _collision),
    "FOLLOW_TARGET": (Layout("<2Q2i17fB"), guidance.follow_target),
    "SET_POSITION_TARGET_LOCAL_NED": (Layout("<I11fH3B", boot_ms=0), guidance.setpoint),
    "CURRENT_MODE": (Layout("<2IB"), lambda f, h: CurrentMode(**h, custom_mode=f[0], intended_mode=f[1])),
    "EXTENDED_SYS_STATE": (Layout("<2B"), lambda f, h: LandedState(**h, on_ground=ON_GROUND.get(f[1]))),
    **{name: (Layout(form), convert) for name, (form, convert) in parameters.CONVERT.items()},
}
