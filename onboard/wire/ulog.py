"""PX4 ULog (.ulg) -> records of our vehicle, from the autopilot's own log. It never holds camera points.

Stamps are the autopilot's boot clock; the time of arrival is taken to be the same, there being no link.
"""

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from onboard.messages import Attitude, Barometer, Clock, GpsFix, Heartbeat, Imu, LocalPosition, Message
from onboard.wire.tlog import NotALogError

MAGIC: Final = b"ULog\x01\x12\x35"
PX4: Final = 12
RATES: Final = "vehicle_angular_velocity"
SPEEDS: Final = ("rollspeed", "pitchspeed", "yawspeed")
ACTIVE: Final = 4


def read_ulog(path: Path) -> Iterator[Message]:
    """The messages of a ULog in time order, after one heartbeat that names the autopilot and the vehicle type.

    Raises NotALogError when it cannot be read.
    """
    from pyulog import ULog  # noqa: PLC0415 - a flight never needs it

    try:
        log = ULog(str(path), [*CONVERT, RATES], disable_str_exceptions=True)
    except (TypeError, ValueError, IndexError, KeyError, AttributeError, EOFError) as error:
        raise NotALogError(f"this ULog cannot be read: {error}") from error
    topics = {topic.name: topic.data for topic in log.data_list if topic.multi_id == 0}
    _add_rates(topics)
    streams = [_stream(name, data) for name, data in topics.items() if name in CONVERT]
    if not streams:
        raise NotALogError("this ULog holds no attitude, position, IMU or GPS")
    kind = int(log.initial_parameters.get("MAV_TYPE", 2))
    start_ns = int(log.start_timestamp) * 1000
    yield Heartbeat(**_header(start_ns), vehicle_type=kind, autopilot=PX4, armed=False, status=ACTIVE)
    yield from heapq.merge(*streams, key=lambda m: m.t_ns)


def _add_rates(topics: dict[str, Any]) -> None:
    """Add body rates to the attitude in newer logs, which keep them apart: the gyro's, at the attitude's times."""
    attitude = topics.get("vehicle_attitude")
    rates, fields = topics.get(RATES), [f"xyz[{k}]" for k in range(3)]
    if rates is None:
        rates, fields = topics.get("sensor_combined"), [f"gyro_rad[{k}]" for k in range(3)]
    if attitude is None or rates is None or "rollspeed" in attitude or not len(rates["timestamp"]):
        return
    for name, field in zip(SPEEDS, fields, strict=True):
        attitude[name] = np.interp(attitude["timestamp"], rates["timestamp"], rates[field])


def _stream(name: str, columns: Any) -> Iterator[Message]:
    """One topic's messages. `columns` maps each field's name to an array over the topic's rows."""
    convert = CONVERT[name]
    for i, t_us in enumerate(columns["timestamp"].tolist()):
        message = convert(columns, i, _header(t_us * 1000))
        if message is not None:
            yield message


def _header(t_ns: int) -> dict[str, Any]:
    return {"t_ns": t_ns, "t_recv_ns": t_ns, "clock": Clock.BOOT}


def _vector(columns: Any, i: int, *names: str) -> Any:
    """The named fields of one row, as a tuple of floats."""
    return tuple(float(columns[name][i]) for name in names)


def _attitude(c: Any, i: int, header: dict[str, Any]) -> Message:
    omega = _vector(c, i, *SPEEDS) if SPEEDS[0] in c else (0.0, 0.0, 0.0)
    return Attitude(**header, q_nb=_vector(c, i, "q[0]", "q[1]", "q[2]", "q[3]"), omega_b=omega)


def _local_position(c: Any, i: int, header: dict[str, Any]) -> Message | None:
    if not (c["xy_valid"][i] and c["z_valid"][i]):
        return None
    return LocalPosition(**header, r_OF_n=_vector(c, i, "x", "y", "z"), v_F_n=_vector(c, i, "vx", "vy", "vz"))


def _imu(c: Any, i: int, header: dict[str, Any]) -> Message:
    f_b = _vector(c, i, *(f"accelerometer_m_s2[{k}]" for k in range(3)))
    return Imu(**header, f_b=f_b, omega_b=_vector(c, i, *(f"gyro_rad[{k}]" for k in range(3))))


def _air_data(c: Any, i: int, header: dict[str, Any]) -> Message:
    return Barometer(**header, pressure_altitude=float(c["baro_alt_meter"][i]))


def _gps(c: Any, i: int, header: dict[str, Any]) -> Message:
    if "latitude_deg" in c:
        lat, lon, alt = _vector(c, i, "latitude_deg", "longitude_deg", "altitude_msl_m")
    else:  # before PX4 1.14: degE7 and mm
        lat, lon, alt = (
            x * s for x, s in zip(_vector(c, i, "lat", "lon", "alt"), (1e-7, 1e-7, 1e-3), strict=True)
        )
    speed, course, eph, epv = _vector(c, i, "vel_m_s", "cog_rad", "eph", "epv")
    return GpsFix(
        **header,
        fix_type=int(c["fix_type"][i]),
        satellites=int(c["satellites_used"][i]),
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt,
        ground_speed=speed,
        course_rad=course,
        h_acc=eph,
        v_acc=epv,
        v_down=float(c["vel_d_m_s"][i]) if c["vel_ned_valid"][i] else None,
    )


CONVERT: Final[dict[str, Callable[[Any, int, dict[str, Any]], Message | None]]] = {
    "vehicle_attitude": _attitude,
    "vehicle_local_position": _local_position,
    "sensor_combined": _imu,
    "vehicle_air_data": _air_data,
    "vehicle_gps_position": _gps,
}
