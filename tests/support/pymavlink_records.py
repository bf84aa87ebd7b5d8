"""Records of vehicles and traffic from pymavlink's messages, to hold our decoder to.

One function a message, by its name in RECORDS; they read fields by pymavlink's names, where ours read them by
their places on the wire.
"""

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.quaternion import QuaternionBase

from onboard.messages import (
    ActuatorOutputs,
    AdsbVehicle,
    AltitudeType,
    Attitude,
    Barometer,
    Battery,
    Clock,
    Collision,
    DistanceReading,
    EstimatorStatus,
    FollowTarget,
    GimbalAttitude,
    GlobalOrigin,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Message,
    MountAttitude,
    Setpoint,
    StatusText,
    SystemTime,
    TimeSync,
    Vec3,
)
from onboard.messages.base import Quaternion

GRAVITY: Final = 9.80665
# ISO 2533: pressure (Pa) and temperature (K) at sea level, K per m, and the gas constant of dry air, J / (kg K)
P_0, T_0, BETA, GAS = 101_325.0, 288.15, -0.0065, 287.05287


def _odometry(m: Any, h: dict[str, Any]) -> Message | None:
    """Return the attitude variances: the last three diagonal terms of a packed 6 x 6 upper triangle."""
    roll, pitch, yaw = (m.pose_covariance[i] for i in (15, 18, 20))
    unknown = dict.fromkeys(("horizontal_velocity", "horizontal_position"))
    if not all(v > 0.0 and math.isfinite(v) for v in (roll, pitch, yaw)):
        return EstimatorStatus(**h, **unknown, resets=m.reset_counter)
    yaw_sigma, tilt_sigma = (math.sqrt(min(v, math.pi**2)) for v in (yaw, max(roll, pitch)))
    return EstimatorStatus(**h, **unknown, yaw_sigma=yaw_sigma, tilt_sigma=tilt_sigma, resets=m.reset_counter)


def _known(value: float, unknown: float, scale: float) -> float | None:
    """A scaled field, None where it holds the number that stands for "unknown"."""
    return None if value == unknown else value * scale


def _heartbeat(m: Any, h: dict[str, Any]) -> Message:
    armed = bool(m.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    kinds = {"vehicle_type": m.type, "autopilot": m.autopilot, "custom_mode": m.custom_mode}
    return Heartbeat(**h, **kinds, armed=armed, status=m.system_status)


def _attitude(m: Any, h: dict[str, Any]) -> Message:
    return Attitude(**h, q_nb=_quaternion(m.roll, m.pitch, m.yaw), omega_b=_rates(m))


def _distance(m: Any, h: dict[str, Any]) -> Message:
    measured = m.current_distance > 0 and m.min_distance <= m.current_distance <= m.max_distance
    return DistanceReading(
        **h | {"t_ns": h["t_recv_ns"], "clock": Clock.NONE},
        sensor=m.id,
        distance=m.current_distance * 0.01 if measured and m.signal_quality != 1 else None,
        sigma=0.01 * math.sqrt(m.covariance) if m.covariance not in (0, 255) else None,
    )


def _gimbal(m: Any, h: dict[str, Any]) -> Message:
    vehicle, earth = m.flags & 32, m.flags & 64
    north = bool(earth) if vehicle or earth else bool(m.flags & 16)
    mount = MountAttitude(q=tuple(m.q), frame="earth" if north else "heading")
    return GimbalAttitude(**h, device=m.gimbal_device_id or h["component"], mount=mount)


def _mount_orientation(m: Any, h: dict[str, Any]) -> Message:
    roll, pitch, yaw = (math.radians(x) for x in (m.roll, m.pitch, m.yaw))
    q = _quaternion(0.0 if math.isnan(roll) else roll, pitch, yaw)
    return GimbalAttitude(**h, device=h["component"], mount=MountAttitude(q=q, frame="heading"), is_replaced=True)


def _global_position(m: Any, h: dict[str, Any]) -> Message:
    heading = _known(m.hdg, 65535, math.pi / 18000)
    return GlobalPosition(
        **h,
        lat_deg=m.lat * 1e-7,
        lon_deg=m.lon * 1e-7,
        alt_msl=m.alt * 1e-3,
        height=m.relative_alt * 1e-3,
        v_F_n=(m.vx * 0.01, m.vy * 0.01, m.vz * 0.01),
        heading_rad=heading,
    )


def _estimator_status(m: Any, h: dict[str, Any]) -> Message:
    """Both autopilots use the same bits. A report of zeros only says nothing."""
    if not any(v for k, v in m.to_dict().items() if k not in {"mavpackettype", "time_usec", "airspeed_variance"}):
        return EstimatorStatus(**h, horizontal_velocity=None, horizontal_position=None)
    is_px4 = m.get_type() == "ESTIMATOR_STATUS"
    fixed = bool(m.flags & dialect.ESTIMATOR_CONST_POS_MODE)
    position = dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS
    return EstimatorStatus(
        **h,
        horizontal_velocity=bool(m.flags & dialect.ESTIMATOR_VELOCITY_HORIZ) and (is_px4 or not fixed),
        horizontal_position=bool(m.flags & position) and (is_px4 or not fixed),
        is_at_rest=fixed and is_px4,
    )


def _gps_fix(m: Any, h: dict[str, Any]) -> Message:
    satellites = None if m.satellites_visible == 255 else m.satellites_visible
    return GpsFix(
        **h,
        fix_type=m.fix_type,
        satellites=satellites,
        lat_deg=m.lat * 1e-7,
        lon_deg=m.lon * 1e-7,
        alt_msl=m.alt * 1e-3,
        ground_speed=_known(m.vel, 65535, 0.01),
        course_rad=_known(m.cog, 65535, math.pi / 18000),
        h_acc=_known(m.h_acc, 0, 1e-3),
        v_acc=_known(m.v_acc, 0, 1e-3),
    )


def _highres_imu(m: Any, h: dict[str, Any]) -> Message:
    return Imu(
        **h,
        f_b=(m.xacc, m.yacc, m.zacc),
        omega_b=(m.xgyro, m.ygyro, m.zgyro),
        pressure_altitude=m.pressure_alt if m.fields_updated & dialect.HIGHRES_IMU_UPDATED_PRESSURE_ALT else None,
    )


def _scaled_pressure(m: Any, h: dict[str, Any]) -> Message:
    """Return the altitude in the troposphere of ISO 2533, NaN for a pressure that is not positive.

    The exponent follows from its constants. test_mavlink_decode compares the decoder with the standard's table.
    """
    ratio = 100.0 * m.press_abs / P_0
    altitude = T_0 / BETA * (ratio ** (-BETA * GAS / GRAVITY) - 1.0) if ratio > 0.0 else math.nan
    return Barometer(**h, pressure_altitude=altitude)


def _scaled_imu(m: Any, h: dict[str, Any]) -> Message:
    milli_g, milli = GRAVITY * 1e-3, 1e-3
    f_b = (m.xacc * milli_g, m.yacc * milli_g, m.zacc * milli_g)
    return Imu(**h, f_b=f_b, omega_b=(m.xgyro * milli, m.ygyro * milli, m.zgyro * milli))


def _quaternion(roll: float, pitch: float, yaw: float) -> Quaternion:
    """(w, x, y, z) by pymavlink's own conversion."""
    w, x, y, z = QuaternionBase([roll, pitch, yaw]).q.tolist()
    return w, x, y, z


def _rates(m: Any) -> Vec3:
    return m.rollspeed, m.pitchspeed, m.yawspeed


def _servo_output(m: Any, h: dict[str, Any]) -> Message:
    return ActuatorOutputs(**h, pwm_us=tuple(getattr(m, f"servo{i}_raw") for i in range(1, 17)), port=m.port)


def _battery(millivolts: int, h: dict[str, Any]) -> Message | None:
    return Battery(**h, voltage_v=millivolts * 1e-3) if millivolts not in {0, 65535} else None


def _battery_status(m: Any, h: dict[str, Any]) -> Message | None:
    cells = [mv for mv in (*m.voltages, *m.voltages_ext) if mv not in {0, 65535}]
    return _battery(sum(cells), h) if m.id == 0 else None


def _adsb_vehicle(m: Any, h: dict[str, Any]) -> Message:
    """A field whose flag is not set is unknown."""

    def has(flag: int) -> bool:
        return bool(m.flags & flag)

    coordinates = has(dialect.ADSB_FLAGS_VALID_COORDS)
    geometric = m.altitude_type == dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC
    return AdsbVehicle(
        **h,
        icao=m.ICAO_address,
        lat_deg=m.lat * 1e-7 if coordinates else None,
        lon_deg=m.lon * 1e-7 if coordinates else None,
        altitude=m.altitude * 1e-3 if has(dialect.ADSB_FLAGS_VALID_ALTITUDE) else None,
        altitude_type=AltitudeType.GEOMETRIC if geometric else AltitudeType.PRESSURE,
        course=m.heading * math.pi / 18000 if has(dialect.ADSB_FLAGS_VALID_HEADING) else None,
        ground_speed=m.hor_velocity * 0.01 if has(dialect.ADSB_FLAGS_VALID_VELOCITY) else None,
        climb=m.ver_velocity * 0.01 if has(dialect.ADSB_FLAGS_VERTICAL_VELOCITY_VALID) else None,
        callsign=_text(m.callsign) if has(dialect.ADSB_FLAGS_VALID_CALLSIGN) else "",
        emitter=m.emitter_type,
        tslc=float(m.tslc),
        squawk=m.squawk if has(dialect.ADSB_FLAGS_VALID_SQUAWK) else None,
        simulated=has(dialect.ADSB_FLAGS_SIMULATED),
    )


def _text(field: str | bytes) -> str:
    """A character field up to its first NUL, printable ASCII only."""
    text = field if isinstance(field, str) else field.decode("ascii", "replace")
    return "".join(c for c in text.split("\0")[0] if c.isascii() and c.isprintable()).strip()


def _collision(m: Any, h: dict[str, Any]) -> Message:
    return Collision(
        **h,
        source=m.src,
        threat=m.id,
        threat_level=m.threat_level,
        time=m.time_to_minimum_delta,
        vertical=m.altitude_minimum_delta,
        horizontal=m.horizontal_minimum_delta,
    )


def _follow_target(m: Any, h: dict[str, Any]) -> Message:
    north, east, down = (math.sqrt(max(variance, 0.0)) for variance in m.position_cov)
    return FollowTarget(
        **h | {"t_ns": m.timestamp * 1_000_000},
        lat_deg=m.lat * 1e-7,
        lon_deg=m.lon * 1e-7,
        alt_msl=m.alt,
        v_n=tuple(m.vel),
        a_n=tuple(m.acc) if m.est_capabilities & 4 else None,
        q_nL=tuple(m.attitude_q) if m.est_capabilities & 8 else None,
        position_sigma=(north, east, down),
    )


def _setpoint(m: Any, h: dict[str, Any]) -> Message | None:
    if m.type_mask != 0 or m.coordinate_frame != 1:
        return None
    return Setpoint(
        **h,
        target_system=m.target_system,
        target_component=m.target_component,
        r_OF_n=(m.x, m.y, m.z),
        v_F_n=(m.vx, m.vy, m.vz),
        a_F_n=(m.afx, m.afy, m.afz),
        yaw=m.yaw,
        yaw_rate=m.yaw_rate,
    )


RECORDS: Final[dict[str, Callable[[Any, dict[str, Any]], Message | None]]] = {
    "HEARTBEAT": _heartbeat,
    "SYSTEM_TIME": lambda m, h: SystemTime(**h, unix_ns=m.time_unix_usec * 1000),
    "TIMESYNC": lambda m, h: TimeSync(**h, tc1_ns=m.tc1, ts1_ns=m.ts1),
    "ATTITUDE_QUATERNION": lambda m, h: Attitude(**h, q_nb=(m.q1, m.q2, m.q3, m.q4), omega_b=_rates(m)),
    "ATTITUDE": _attitude,
    "LOCAL_POSITION_NED": lambda m, h: LocalPosition(**h, r_OF_n=(m.x, m.y, m.z), v_F_n=(m.vx, m.vy, m.vz)),
    "GLOBAL_POSITION_INT": _global_position,
    "EKF_STATUS_REPORT": _estimator_status,
    "ESTIMATOR_STATUS": _estimator_status,
    "ODOMETRY": _odometry,
    "DISTANCE_SENSOR": _distance,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": _gimbal,
    "MOUNT_ORIENTATION": _mount_orientation,
    "GPS_GLOBAL_ORIGIN": lambda m, h: GlobalOrigin(
        **h, lat_deg=m.latitude * 1e-7, lon_deg=m.longitude * 1e-7, alt_msl=m.altitude * 1e-3
    ),
    "GPS_RAW_INT": _gps_fix,
    "HIGHRES_IMU": _highres_imu,
    "SCALED_IMU": _scaled_imu,
    "RAW_IMU": _scaled_imu,
    "SCALED_PRESSURE": _scaled_pressure,
    "SERVO_OUTPUT_RAW": _servo_output,
    "SYS_STATUS": lambda m, h: _battery(m.voltage_battery, h),
    "BATTERY_STATUS": _battery_status,
    "STATUSTEXT": lambda m, h: StatusText(**h, severity=m.severity, text=m.text),
    "ADSB_VEHICLE": _adsb_vehicle,
    "COLLISION": _collision,
    "FOLLOW_TARGET": _follow_target,
    "EXTENDED_SYS_STATE": lambda m, h: LandedState(
        **h, on_ground={1: True, 2: False, 3: True, 4: False}.get(m.landed_state)
    ),
    "SET_POSITION_TARGET_LOCAL_NED": _setpoint,
}
