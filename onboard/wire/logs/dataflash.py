"""ArduPilot's DataFlash log (.bin) -> records of our vehicle, without camera points.

Stamps are the autopilot's boot clock. Arrivals are the same times on the Unix clock, by the median of the GPS's
3-D fixes (0.1 to 0.2 s late), so that images with Unix times can be matched. Without a fix they are on the boot
clock.
"""

import io
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Battery,
    Clock,
    EstimatorStatus,
    GlobalOrigin,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
    ParamValue,
    StatusText,
)
from onboard.messages.base import Vec3
from onboard.messages.mavlink_enums import ARDUPILOT
from onboard.messages.text import MAX_LINE_LENGTH, plain
from onboard.wire.logs.gps_time import DAY_LENGTH_US, GPS_EPOCH_US, boot_time_ns, corrected
from onboard.wire.logs.tlog import NotALogError
from onboard.wire.mavlink.records import barometer

MAGIC: Final = b"\xa3\x95"
# By how much GPS time is ahead of UTC, s, since a day of GPS time: 2017, 2015, and before.
LEAP_S: Final = ((13510, 18), (12960, 17), (0, 16))
MAX_TIME_US: Final = 2**53  # 285 years after boot
UNREADABLE: Final = Exception  # pymavlink raises that itself, besides all that Python does of damaged bytes
INSTANCES: Final = ("I", "C", "Inst", "Instance")  # the field that numbers a row's sensor or core
RENAMED_ROWS: Final = {  # of firmware that numbers rows in their names: the name today, and the instance
    "GPS2": ("GPS", 1),
    "GPA2": ("GPA", 1),
    "IMU2": ("IMU", 1),
    "IMU3": ("IMU", 2),
    "BAR2": ("BARO", 1),
    "NKF6": ("NKF1", 1),
    "NKF9": ("NKF4", 1),
    "XKF6": ("XKF1", 1),
    "XKF9": ("XKF4", 1),
}
TIMES: Final = frozenset({"TimeUS", "TimeMS", "T"})  # fields of which a row has one; texts of 2015 have none
SENSOR_TIMEOUT_US: Final = 2_000_000  # before another instance is read
LOG_ROWS: Final = (
    *("ATT", "IMU", "XKF1", "NKF1", "EKF1", "XKF4", "NKF4", "EKF4", "ORGN", "GPS", "GPA", "BARO", "RCOU"),
    *("BAT", "CURR"),
)
TEXT_ROWS: Final = ("MODE", "ARM", "MSG")  # no time base begins with them
Lose = Callable[[str], None]
Header = dict[str, Any]


def read_dataflash(path: Path, lose: Lose = lambda _: None) -> Iterator[tuple[Message, int]]:
    """Read (message, bytes of the file consumed so far) in the order of the log.

    The first message is a heartbeat with the vehicle type; later heartbeats state mode and arming. Parameters have
    the time of the row before. Each sensor is read from its first instance until that gives nothing usable (a GPS:
    no 3-D fix) for 2 s, the EKF from the primary core. `lose` receives the reason for each unusable row.

    Raises NotALogError when the log cannot be read.
    """
    from pymavlink import DFReader  # noqa: PLC0415 - a flight never needs it

    log: Any = DFReader.DFReader_binary.__new__(DFReader.DFReader_binary)  # so that it is closed if reading fails
    try:
        with _quiet(), _quiet_library():
            DFReader.DFReader_binary.__init__(log, str(path))
            if "ATT" not in log.name_to_id:
                raise NotALogError("this DataFlash log holds no attitude (ATT)")
            for _ in _rows(log, ("PARM", "MSG"), lambda _: None):
                pass  # which fills in the log's parameters and the vehicle's type
            offset_ns = boot_time_ns(_fix_times(log), lose)
        yield from _messages(log, offset_ns, lose)
    except UNREADABLE as error:
        if isinstance(error, NotALogError):
            raise
        raise NotALogError(f"this DataFlash log cannot be read: {error}") from error
    finally:
        for part in ("data_map", "filehandle"):
            with suppress(AttributeError, BufferError):  # not opened yet, or still in the error's traceback
                getattr(log, part).close()


def _messages(log: Any, offset_ns: int, lose: Lose) -> Iterator[tuple[Message, int]]:
    system = int(log.params.get("SYSID_THISMAV", log.params.get("MAV_SYSID", 1)))
    system = system if 0 < system < 256 else 1
    converter, said = _Converter(), _TextConverter(int(log.mav_type))
    newest, waiting = Header(), list[Any]()
    for row in _rows(log, (), lose):
        kind, instance = RENAMED_ROWS.get(row.get_type(), (row.get_type(), _instance(row)))
        if kind == "PARM":
            waiting.append(row)  # the first for the heartbeat; old ones have no time of their own
            if newest:
                yield from _parameters(log, waiting, newest, lose)
        if kind not in LOG_ROWS and kind not in TEXT_ROWS:
            continue
        words = kind in TEXT_ROWS
        if not newest and not TIMES.intersection(row.fmt.columns):
            continue  # texts before the first time
        try:
            header = _header(row, system, offset_ns) if TIMES.intersection(row.fmt.columns) else newest
            message = said.convert(kind, row, header) if words else converter.convert(kind, instance, row, header)
        except UNREADABLE as error:
            lose(f"{kind}: {error}")
            continue
        if message is None or (words and not newest):  # the first heartbeat has the mode that was set before
            continue
        if not newest:
            yield said.heartbeat(header), log.offset
            yield from _parameters(log, waiting, header, lose)
        newest = header
        yield message, log.offset


def _parameters(log: Any, rows: list[Any], header: Header, lose: Lose) -> Iterator[tuple[Message, int]]:
    """Convert and remove waiting parameters; ArduPilot logs their defaults since 4.4."""
    head = {**header, "clock": Clock.NONE, "extended": False}
    for row in rows:
        try:
            default = float(row.Default) if "Default" in row.fmt.columns else math.nan
            known = default if math.isfinite(default) else None
            message = ParamValue(**head, name=str(row.Name), value=float(row.Value), default=known)
        except UNREADABLE as error:
            lose(f"PARM: {error}")
            continue
        yield message, log.offset
    rows.clear()


class _TextConverter:
    """Rows for people -> heartbeats with the mode and whether the motors are armed, and texts."""

    def __init__(self, vehicle_type: int) -> None:
        self._type, self._mode, self._armed = vehicle_type, 0, False

    def convert(self, kind: str, row: Any, header: Header) -> Message:
        """The message of a row."""
        header = header | {"clock": Clock.NONE}
        if kind == "MSG":
            return StatusText(
                **header, severity=dialect.MAV_SEVERITY_INFO, text=plain(str(row.Message), MAX_LINE_LENGTH)
            )
        if kind == "ARM":
            self._armed = bool(row.ArmState)
        else:
            self._mode = _field(row, "ModeNum", "Mode")
        return self.heartbeat(header)

    def heartbeat(self, header: Header) -> Heartbeat:
        """The newest mode, and whether the motors are armed."""
        head = {**header, "vehicle_type": self._type, "autopilot": ARDUPILOT, "status": dialect.MAV_STATE_ACTIVE}
        return Heartbeat(**head, armed=self._armed, custom_mode=self._mode)


class _Converter:
    """Rows -> messages, with body rates for the attitude and accuracies for the fix."""

    def __init__(self) -> None:
        self._rates: Vec3 = (0.0, 0.0, 0.0)
        self._accuracy: tuple[float, float] | None = None
        self._core = 0
        # by kind: the instance, and its last time with something of use
        self._read: dict[str, tuple[int, int]] = {}

    def convert(self, kind: str, instance: int, row: Any, header: Header) -> Message | None:
        """The message of a row; None if it has none or belongs to a sensor that is not read."""
        if kind in ("XKF4", "NKF4") and "PI" in row.fmt.columns:
            self._core = int(row.PI)
        if not self._is_read(kind, instance, row, header["t_ns"] // 1000):
            return None
        if kind == "GPA":
            self._accuracy = (row.HAcc, row.VAcc)
        elif kind == "IMU":
            self._rates = _finite(row, "GyrX", "GyrY", "GyrZ")
            return Imu(**header, f_b=_finite(row, "AccX", "AccY", "AccZ"), omega_b=self._rates)
        elif kind == "ATT":
            angles = (math.radians(angle) for angle in _finite(row, "Roll", "Pitch", "Yaw"))
            w, x, y, z = quaternion_from_euler(*angles).tolist()
            return Attitude(**header, q_nb=(w, x, y, z), omega_b=self._rates)
        elif kind == "GPS":
            return self._fix(row, header)
        elif (convert := CONVERT.get(kind)) is not None:
            return convert(row, header)
        return None

    def _is_read(self, kind: str, instance: int, row: Any, t_us: int) -> bool:
        """Whether this is the instance of its kind that is read."""
        if kind[1:3] == "KF":
            return instance == self._core
        if kind == "GPA":
            return instance == self._read.get("GPS", (instance, 0))[0]
        of_use = kind != "GPS" or int(row.Status) >= dialect.GPS_FIX_TYPE_3D_FIX
        read, last_us = self._read.get(kind, (instance, t_us))
        if instance != read and not (of_use and t_us - last_us > SENSOR_TIMEOUT_US):
            return False
        self._read[kind] = instance, t_us if of_use else last_us
        return True

    def _fix(self, row: Any, header: Header) -> Message:
        lat, lon, alt = _finite(row, "Lat", "Lng", "Alt")
        horizontal, vertical = self._accuracy or (None, None)
        return GpsFix(
            **header,
            fix_type=int(row.Status),
            satellites=int(row.NSats),
            lat_deg=lat,
            lon_deg=lon,
            alt_msl=alt,
            ground_speed=row.Spd,
            course_rad=math.radians(row.GCrs),
            h_acc=horizontal,
            v_acc=vertical,
            v_down=row.VZ if "VZ" in row.fmt.columns else None,
        )


def _local_position(row: Any, header: Header) -> Message:
    return LocalPosition(**header, r_OF_n=_finite(row, "PN", "PE", "PD"), v_F_n=_finite(row, "VN", "VE", "VD"))


def _status(row: Any, header: Header) -> Message:
    """The flags of EKF_STATUS_REPORT without constant-position mode, which is not in this row."""
    flags = int(row.SS)
    return EstimatorStatus(
        **header,
        horizontal_velocity=bool(flags & dialect.ESTIMATOR_VELOCITY_HORIZ),
        horizontal_position=bool(flags & (dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS)),
    )


def _origin(row: Any, header: Header) -> Message | None:
    """Type 0 is the EKF's origin, 1 is home."""
    lat, lon, alt = _finite(row, "Lat", "Lng", "Alt")
    return GlobalOrigin(**header, lat_deg=lat, lon_deg=lon, alt_msl=alt) if int(row.Type) == 0 else None


def _outputs(row: Any, header: Header) -> Message:
    """The fields were Ch1 and on before 2016."""
    values = row.to_dict()
    names = [name for i in range(1, 17) for name in (f"C{i}", f"Ch{i}") if name in values]
    return ActuatorOutputs(**header, pwm_us=tuple(int(values[name]) for name in names))


def _barometer(row: Any, header: Header) -> Message:
    message = barometer(header, row.Press * 0.01)
    if not math.isfinite(message.pressure_altitude):
        raise ValueError(f"its pressure is {row.Press} Pa")
    return message


CONVERT: Final[dict[str, Callable[[Any, Header], Message | None]]] = {
    "XKF1": _local_position,
    "NKF1": _local_position,
    "EKF1": _local_position,
    "XKF4": _status,
    "NKF4": _status,
    "ORGN": _origin,
    "BARO": _barometer,
    "RCOU": _outputs,
    "BAT": lambda row, header: Battery(**header, voltage_v=row.Volt) if row.Volt > 0 else None,
    "CURR": lambda row, header: Battery(**header, voltage_v=row.Volt * 0.01) if row.Volt > 0 else None,
}


def _rows(log: Any, kinds: tuple[str, ...], lose: Lose) -> Iterator[Any]:
    """Rows of these kinds up to the first damage, or of all kinds and across damage.

    `lose` receives what pymavlink prints of the damage.
    """
    log.rewind()
    while True:
        with _quiet() as printed:
            try:
                row = log.recv_match(type={*kinds}, strict=True) if kinds else log.recv_msg()
            except UNREADABLE as error:
                lose(f"the log cannot be read on: {error}")
                return
        if printed.tell():
            lose("bytes that are no row of the log")
        if row is None:
            return
        yield row


def _fix_times(log: Any) -> Iterator[tuple[int, int]]:
    """Unix time and time since boot of each 3-D fix, us."""
    for row in _rows(log, ("GPS", "GPS2"), lambda _: None):
        week = _field(row, "GWk", "Week") if int(row.Status) >= dialect.GPS_FIX_TYPE_3D_FIX else 0
        if week > 0:
            gps_us = GPS_EPOCH_US + week * 7 * DAY_LENGTH_US + 1000 * _field(row, "GMS", "TimeMS")
            day = (corrected(gps_us) - GPS_EPOCH_US) // DAY_LENGTH_US
            leap_s = next(seconds for since, seconds in LEAP_S if day >= since)
            yield gps_us - leap_s * 1_000_000, _time_us(row)


def _time_us(row: Any) -> int:
    """Time since boot, us; firmware before 2015 logs milliseconds."""
    return int(row.TimeUS) if "TimeUS" in row.fmt.columns else 1000 * _field(row, "T", "TimeMS")


def _field(row: Any, *names: str) -> int:
    """The first of these fields that the row has. Raises ValueError."""
    for name in names:
        if name in row.fmt.columns:
            return int(getattr(row, name))
    raise ValueError(f"it has none of {', '.join(names)}")


def _header(row: Any, system: int, offset_ns: int) -> Header:
    t_us = _time_us(row)
    if not 0 <= t_us < MAX_TIME_US:
        raise ValueError("its time cannot be")
    return {"t_ns": t_us * 1000, "t_recv_ns": t_us * 1000 + offset_ns, "clock": Clock.BOOT, "system": system}


def _instance(row: Any) -> int:
    return next((int(getattr(row, name)) for name in INSTANCES if name in row.fmt.columns), 0)


def _finite(row: Any, *names: str) -> Vec3:
    """Return three fields. Raises ValueError if one is not finite."""
    x, y, z = (float(getattr(row, name)) for name in names)
    if not math.isfinite(x + y + z):
        raise ValueError(f"one of {', '.join(names)} is no finite number")
    return x, y, z


@contextmanager
def _quiet_library() -> Iterator[None]:
    """Suppress what pymavlink's index, written in C, prints of each damaged byte."""
    with Path(os.devnull).open("wb") as nowhere:
        screen = os.dup(2)  # standard error
        try:
            os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(screen, 2)
            os.close(screen)


class _quiet(redirect_stdout[io.StringIO]):  # noqa: N801 - used as a function
    """Keeps what pymavlink prints off the screen, in the string that is entered."""

    def __init__(self) -> None:
        super().__init__(io.StringIO())
        self._error = redirect_stderr(self._new_target)  # type: ignore[attr-defined]

    def __enter__(self) -> io.StringIO:
        self._error.__enter__()
        return super().__enter__()

    def __exit__(self, *what: Any) -> None:
        super().__exit__(*what)
        self._error.__exit__(*what)
