"""PX4 ULog (.ulg) -> records of our vehicle; it never holds camera points.

Stamps are the autopilot's boot clock. Arrivals are the same times on the Unix clock, by the median of the GPS's
fixes, so that images with Unix times can be matched. Without UTC in the log they are on the boot clock.
"""

import heapq
import itertools
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Battery,
    Clock,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
    ParamValue,
    StatusText,
)
from onboard.messages.mavlink_enums import PX4
from onboard.messages.text import MAX_LINE_LENGTH, plain
from onboard.wire.logs.gps_time import boot_time_ns
from onboard.wire.logs.tlog import NotALogError

MAGIC: Final = b"ULog\x01\x12\x35"
RATES_TOPIC: Final = "vehicle_angular_velocity"
SPEEDS: Final = ("rollspeed", "pitchspeed", "yawspeed")
STATUS: Final = "vehicle_status"
# vehicle_status.nav_state -> main and sub mode, as PX4 makes HEARTBEAT.custom_mode of it
MODES: Final = {
    0: (1, 0),
    1: (2, 0),
    2: (3, 0),
    3: (4, 4),
    4: (4, 3),
    5: (4, 5),
    10: (5, 0),
    12: (4, 6),
    13: (1, 0),
    14: (6, 0),
    15: (7, 0),
    17: (4, 2),
    18: (4, 6),
    19: (4, 8),
    20: (4, 9),
    21: (3, 1),
    22: (4, 10),
}
MAX_DISORDER_TIME_US: Final = 1_000_000  # by which a row may precede the row before it
MAX_GAP_TIME_US: Final = 60_000_000  # in one topic
MAX_TIME_US: Final = 2**53  # 285 years after boot
MAX_MESSAGE_BYTES: Final = 65_535
MAX_FORMAT_DEPTH: Final = 16  # of nested formats; PX4 has two levels
HEADER_BYTES: Final = 16
SIZES: Final = {
    **dict.fromkeys(("int8_t", "uint8_t", "bool", "char"), 1),
    **dict.fromkeys(("int16_t", "uint16_t"), 2),
    **dict.fromkeys(("int32_t", "uint32_t", "float"), 4),
    **dict.fromkeys(("int64_t", "uint64_t", "double"), 8),
}
UNREADABLE: Final = (
    *(TypeError, ValueError, IndexError, KeyError, AttributeError, EOFError),
    *(OverflowError, MemoryError, RecursionError, struct.error),
)
UTC: Final = "time_utc_usec"  # of a fix
BOOT_UTC: Final = "boot_time_utc_us"  # of the log's head
Lose = Callable[[str], None]


class LogSource(NamedTuple):
    """The MAVLink system of a log, and Unix time less boot time, ns."""

    system: int
    offset_ns: int


def read_ulog(path: Path, lose: Lose = lambda _: None) -> Iterator[Message]:
    """Read the messages of a ULog in time order, with its texts and parameters.

    The first message is a heartbeat with the autopilot and the vehicle type; later heartbeats state mode and
    arming. Each topic is read from its first instance with rows, the actuators' outputs from the instance that
    moves most. `lose` receives the reason for each unusable row or topic.

    Raises NotALogError when the log cannot be read.
    """
    from pyulog import ULog  # noqa: PLC0415 - a flight never needs it

    try:
        with path.open("rb") as file:
            _check_formats(file)
            file.seek(0)
            log = ULog(file, [*CONVERT, STATUS, RATES_TOPIC], disable_str_exceptions=True)
    except UNREADABLE as error:
        if isinstance(error, NotALogError):
            raise
        raise NotALogError(f"this ULog cannot be read: {error}") from error
    topics: dict[str, Any] = {}
    for topic in sorted(log.data_list, key=lambda topic: topic.multi_id, reverse=True):
        if len(topic.data["timestamp"]):
            topics[topic.name] = topic.data
    _choose_outputs(log.data_list, topics)
    topics = {name: _in_order(columns, partial(_name, lose, name)) for name, columns in topics.items()}
    _add_rates(topics)
    offset_ns = _unix_offset_ns(log, topics.get("vehicle_gps_position"), lose)
    source = LogSource(_parameter(log, "MAV_SYS_ID", 1), offset_ns)
    kind, start_ns = int(_parameter(log, "MAV_TYPE", 2)), int(log.start_timestamp) * 1000
    streams = []
    for name, convert in (CONVERT | {STATUS: Converter(partial(_status, kind), _always(*STATES))}).items():
        if name not in topics:
            continue
        missing = [field for field in convert.needs(topics[name]) if field not in topics[name]]
        if missing:
            lose(f"{name}: it has no field {', '.join(missing)}; the topic is not used")
            continue
        streams.append(_stream(convert, topics[name], source, partial(_name, lose, name)))
    if not streams:
        raise NotALogError("this ULog holds no attitude, position, IMU or GPS")
    header = _header(start_ns, source)
    yield Heartbeat(**header, vehicle_type=kind, autopilot=PX4, armed=False, status=dialect.MAV_STATE_ACTIVE)
    messages = _texts(log, source, start_ns), _changes(log, source, start_ns)
    yield from _parameters(log, header)
    yield from heapq.merge(*streams, *messages, key=lambda m: m.t_ns)


def _parameters(log: Any, header: dict[str, Any]) -> Iterator[Message]:
    """The parameters at the start, only the changed ones where the log has defaults."""
    defaults = log.get_default_parameters(0)
    head = {**header, "clock": Clock.NONE, "extended": False}
    for name, value in log.initial_parameters.items():
        default = float(defaults.get(name, value)) if defaults else None
        yield ParamValue(**head, name=str(name), value=float(value), default=default)


def _changes(log: Any, source: LogSource, start_ns: int) -> Iterator[Message]:
    """Parameters that somebody has set later."""
    for t_us, name, value in sorted(log.changed_parameters, key=lambda change: int(change[0])):
        head = _header(max(int(t_us) * 1000, start_ns), source) | {"clock": Clock.NONE}
        yield ParamValue(**head, extended=False, name=str(name), value=float(value))


def _texts(log: Any, source: LogSource, start_ns: int) -> Iterator[Message]:
    """The texts of PX4; its levels are digits. No time base begins with a text."""
    for logged in sorted(log.logged_messages, key=lambda logged: int(logged.timestamp)):
        header = _header(max(int(logged.timestamp) * 1000, start_ns), source) | {"clock": Clock.NONE}
        text = plain(str(logged.message), MAX_LINE_LENGTH)
        yield StatusText(**header, severity=int(logged.log_level) & 7, text=text)


def _check_formats(file: BinaryIO) -> None:
    """Check the formats, which pyulog expands whatever their size.

    Raises NotALogError for a format that is larger than a message or contains itself.
    """
    formats: dict[str, list[str]] = {}
    file.seek(HEADER_BYTES)
    while len(head := file.read(3)) == 3 and head[2:] not in b"AL":  # which data follow
        text = file.read(int.from_bytes(head[:2], "little")).decode(errors="ignore")
        if head[2:] == b"F":
            name, _, fields = text.partition(":")
            formats[name] = [field.split(" ")[0] for field in fields.split(";") if field]
    sizes: dict[str, int] = dict(SIZES)
    for name in formats:
        _add_size(name, formats, sizes, 0)


def _add_size(name: str, formats: dict[str, list[str]], sizes: dict[str, int], depth: int) -> None:
    """Compute the size of a format and of its parts. Raises NotALogError, ValueError."""
    total = 0
    for field in formats.get(name, ()):
        kind, _, count = field.partition("[")
        if kind not in sizes:
            if depth >= MAX_FORMAT_DEPTH:
                raise NotALogError(f"this ULog's format {plain(name)} has {MAX_FORMAT_DEPTH} formats inside it")
            _add_size(kind, formats, sizes, depth + 1)
        total += sizes[kind] * max(1, int(count.partition("]")[0]) if count else 1)
        if total > MAX_MESSAGE_BYTES:
            raise NotALogError(f"this ULog's format {plain(name)} has more than {MAX_MESSAGE_BYTES} bytes")
    sizes[name] = total


def _name(lose: Lose, topic: str, reason: str) -> None:
    lose(f"{topic}: {reason}")


def _parameter(log: Any, name: str, default: int) -> int:
    """A parameter at the start, the default unless it is 1 to 255."""
    value = log.initial_parameters.get(name, default)
    return int(value) if isinstance(value, (int, float)) and 1 <= value <= 255 else default


def _in_order(columns: Any, lose: Lose) -> Any:
    """Order a topic's rows by their stamps, without those far from the rows around them."""
    stamps = columns["timestamp"].tolist()
    kept, last = [], None
    for i, (t, following) in enumerate(itertools.zip_longest(stamps, stamps[1:])):
        is_near = last is not None and abs(t - last) <= MAX_DISORDER_TIME_US
        if following is None:
            is_near = is_near or last is None or 0 <= t - last <= MAX_GAP_TIME_US
        elif not is_near:
            is_near = -MAX_DISORDER_TIME_US <= following - t <= MAX_GAP_TIME_US
        if not is_near or t >= MAX_TIME_US:
            lose("a row's stamp is far from those of the rows around it")
            continue
        kept.append(i)
        last = t
    order = np.array(kept, dtype=int)[np.argsort([stamps[i] for i in kept], kind="stable")]
    return {name: values[order] for name, values in columns.items()}


def _choose_outputs(instances: Any, topics: dict[str, Any]) -> None:
    """Put that instance of the actuators' outputs among the topics that moves most."""
    boards = [one.data for one in instances if one.name == OUTPUTS and len(one.data["timestamp"])]
    if len(boards) > 1:
        topics[OUTPUTS] = max(
            boards, key=lambda c: sum(float(np.ptp(c[f])) for f in OUTPUT if f in c and np.isfinite(c[f]).all())
        )


def _add_rates(topics: dict[str, Any]) -> None:
    """Add the gyro's body rates at the attitude's times; newer logs keep them apart."""
    attitude = topics.get("vehicle_attitude")
    rates, fields = topics.get(RATES_TOPIC), [f"xyz[{k}]" for k in range(3)]
    if rates is None:
        rates, fields = topics.get("sensor_combined"), [f"gyro_rad[{k}]" for k in range(3)]
    if attitude is None or rates is None or "rollspeed" in attitude or not all(f in rates for f in fields):
        return
    known = np.isfinite([rates[field] for field in fields]).all(axis=0)
    if not known.any():
        return
    for name, field in zip(SPEEDS, fields, strict=True):
        attitude[name] = np.interp(attitude["timestamp"], rates["timestamp"][known], rates[field][known])


def _stream(convert: "Converter", columns: Any, source: LogSource, lose: Lose) -> Iterator[Message]:
    """Convert one topic, whose `columns` map field names to arrays over its rows."""
    needs = convert.needs(columns)
    for i, t_us in enumerate(columns["timestamp"].tolist()):
        unknown = [name for name in needs if not np.isfinite(columns[name][i])]
        if unknown:
            lose(f"a row's {', '.join(unknown)} is no finite number")
            continue
        message = convert.read(columns, i, _header(t_us * 1000, source))
        if message is not None:
            yield message


def _header(t_ns: int, source: LogSource) -> dict[str, Any]:
    return {"t_ns": t_ns, "t_recv_ns": t_ns + source.offset_ns, "clock": Clock.BOOT, "system": source.system}


def _unix_offset_ns(log: Any, fixes: Any, lose: Lose) -> int:
    """Unix time minus boot time, ns, by the fixes' median, else by the log's header, else 0."""
    if fixes is not None and UTC in fixes:
        times = zip(map(int, fixes[UTC].tolist()), map(int, fixes["timestamp"].tolist()), strict=True)
        if offset_ns := boot_time_ns(times, lose):
            return offset_ns
    boot_us = log.msg_info_dict.get(BOOT_UTC, 0)
    return boot_time_ns([(boot_us, 0)], lose) if isinstance(boot_us, int) and boot_us < MAX_TIME_US else 0


def _vector(columns: Any, i: int, *names: str) -> Any:
    """The named fields of one row, as a tuple of floats."""
    return tuple(float(columns[name][i]) for name in names)


def _known(columns: Any, i: int, name: str) -> float | None:
    """A field that may be missing or NaN, which are unknown."""
    value = float(columns[name][i]) if name in columns else np.nan
    return value if np.isfinite(value) else None


def _attitude(c: Any, i: int, header: dict[str, Any]) -> Message:
    omega = _vector(c, i, *SPEEDS) if SPEEDS[0] in c else (0.0, 0.0, 0.0)
    return Attitude(**header, q_nb=_vector(c, i, *QUATERNION_FIELDS), omega_b=omega)


def _local_position(c: Any, i: int, header: dict[str, Any]) -> Message | None:
    if not (c["xy_valid"][i] and c["z_valid"][i]):
        return None
    return LocalPosition(**header, r_OF_n=_vector(c, i, *FIELDS_NED[:3]), v_F_n=_vector(c, i, *FIELDS_NED[3:]))


def _imu(c: Any, i: int, header: dict[str, Any]) -> Message:
    return Imu(**header, f_b=_vector(c, i, *IMU[:3]), omega_b=_vector(c, i, *IMU[3:]))


def _air_data(c: Any, i: int, header: dict[str, Any]) -> Message:
    return Barometer(**header, pressure_altitude=float(c["baro_alt_meter"][i]))


def _gps(c: Any, i: int, header: dict[str, Any]) -> Message:
    lat, lon, alt = _vector(c, i, *_place(c)[:3])
    if "latitude_deg" not in c:
        lat, lon, alt = lat * 1e-7, lon * 1e-7, alt * 1e-3
    return GpsFix(
        **header,
        fix_type=int(c["fix_type"][i]),
        satellites=int(c["satellites_used"][i]) if "satellites_used" in c else None,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt,
        ground_speed=_known(c, i, "vel_m_s"),
        course_rad=_known(c, i, "cog_rad"),
        h_acc=_known(c, i, "eph"),
        v_acc=_known(c, i, "epv"),
        v_down=_known(c, i, "vel_d_m_s") if "vel_ned_valid" in c and c["vel_ned_valid"][i] else None,
    )


def _outputs(c: Any, i: int, header: dict[str, Any]) -> Message:
    values = [float(c[name][i]) for name in OUTPUT[: int(c["noutputs"][i])] if name in c]
    return ActuatorOutputs(**header, pwm_us=tuple(round(v) if np.isfinite(v) else 0 for v in values))


def _status(kind: int, c: Any, i: int, header: dict[str, Any]) -> Message:
    """A heartbeat with the mode and the arming; modes of later versions by their number."""
    state, is_armed = int(c["nav_state"][i]), int(c["arming_state"][i]) == 2  # ARMING_STATE_ARMED
    main, sub = MODES.get(state, (0, state))
    return Heartbeat(
        **header | {"clock": Clock.NONE},
        vehicle_type=kind,
        autopilot=PX4,
        armed=is_armed,
        status=dialect.MAV_STATE_ACTIVE,
        custom_mode=sub << 24 | main << 16,
    )


def _battery(c: Any, i: int, header: dict[str, Any]) -> Message | None:
    voltage = float(c["voltage_v"][i])
    return Battery(**header, voltage_v=voltage) if voltage > 0 else None


def _place(columns: Any) -> tuple[str, ...]:
    """The fields that a fix needs: before PX4 1.14 in degE7 and mm."""
    is_new = "latitude_deg" in columns
    return (*(NEW_PLACE if is_new else ("lat", "lon", "alt")), "fix_type")


class Converter(NamedTuple):
    """A converter of a topic's rows, and the fields that it requires."""

    read: Callable[[Any, int, dict[str, Any]], Message | None]
    needs: Callable[[Any], tuple[str, ...]]


def _always(*names: str) -> Callable[[Any], tuple[str, ...]]:
    return lambda _: names


QUATERNION_FIELDS: Final = tuple(f"q[{k}]" for k in range(4))
FIELDS_NED: Final = ("x", "y", "z", "vx", "vy", "vz")
STATES: Final = ("nav_state", "arming_state")
IMU: Final = (*(f"accelerometer_m_s2[{k}]" for k in range(3)), *(f"gyro_rad[{k}]" for k in range(3)))
OUTPUTS: Final = "actuator_outputs"
OUTPUT: Final = tuple(f"output[{k}]" for k in range(16))
NEW_PLACE: Final = ("latitude_deg", "longitude_deg", "altitude_msl_m")
CONVERT: Final = {
    "vehicle_attitude": Converter(_attitude, _always(*QUATERNION_FIELDS)),
    "vehicle_local_position": Converter(_local_position, _always(*FIELDS_NED, "xy_valid", "z_valid")),
    "sensor_combined": Converter(_imu, _always(*IMU)),
    OUTPUTS: Converter(_outputs, _always("noutputs")),
    "battery_status": Converter(_battery, _always("voltage_v")),
    "vehicle_air_data": Converter(_air_data, _always("baro_alt_meter")),
    "vehicle_gps_position": Converter(_gps, _place),
}
