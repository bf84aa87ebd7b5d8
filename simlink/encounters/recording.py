"""Logged motion of a vehicle: position, velocity, attitude, specific force.

It reads ArduPilot .bin, PX4 .ulg, .tlog and .csv. The head line of a .csv names, in any order, `time_s`,
`north_m`, `east_m`, `down_m`, `q_w`, `q_x`, `q_y`, `q_z` (body FRD to NED) and optionally `v_north_m_s`,
`v_east_m_s`, `v_down_m_s` and `mav_type` (1: fixed wing). It suits motion capture and data sets.
"""

import csv
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from onboard.geometry.geodesy import ned_from_geodetic
from onboard.messages import Attitude, Clock, GlobalPosition, GpsFix, Heartbeat, Imu, LocalPosition, Message
from onboard.units import S_PER_NS
from onboard.wire.logs import dataflash, ulog
from onboard.wire.logs.tlog import NotALogError, read_tlog
from onboard.wire.mavlink.decode import MavlinkDecoder
from simlink.encounters.families import LeaderClass
from simlink.sensors.arrays import Array

FIXED_WING: Final = 1  # MAV_TYPE
MIN_FIX_TYPE: Final = 3  # GPS_FIX_TYPE_3D_FIX
SUFFIXES: Final = (".bin", ".ulg", ".tlog", ".csv")
POSITION_COLUMNS: Final = ("time_s", "north_m", "east_m", "down_m")
VELOCITY_COLUMNS: Final = ("v_north_m_s", "v_east_m_s", "v_down_m_s")
ATTITUDE_COLUMNS: Final = ("q_w", "q_x", "q_y", "q_z")
MESSAGE_TYPES: Final = (Attitude, LocalPosition, GlobalPosition, GpsFix, Imu, Heartbeat)
EMPTY: Final[Array] = np.empty((0, 0))


class LogError(ValueError):
    """A log without a usable flight; the message names the log and the reason."""


class Recording(NamedTuple):
    """The samples of one log, in rows ordered by their first column, the time (s).

    `is_gps` marks positions that come, late, from a receiver instead of an EKF.
    """

    name: str
    places: Array  # (n, 7): position and velocity in n; NaN where the velocity is unknown
    attitudes: Array  # (m, 5): q_nb
    forces: Array  # (k, 4): specific force in b
    arms: Array  # (j, 2): 1 if the motors are armed
    leader_class: LeaderClass = "multirotor"
    is_gps: bool = False


def read_recording(path: Path) -> Recording:
    """Read the motion from a log of any known format. Raises LogError."""
    try:
        if path.suffix.lower() == ".csv":
            return _from_csv(path)
        return _from_messages(path, _messages(path))
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from error
    except (NotALogError, UnicodeDecodeError, csv.Error) as error:
        raise LogError(f"{path}: {error}") from error


def _messages(path: Path) -> Iterator[Message]:
    with path.open("rb") as file:
        head = file.read(8)
    if head.startswith(ulog.MAGIC):
        yield from ulog.read_ulog(path)
    elif head.startswith(dataflash.MAGIC):
        yield from (message for message, _ in dataflash.read_dataflash(path))
    else:
        decoder = MavlinkDecoder(stream=False)
        with path.open("rb") as file:
            for datagram, _ in read_tlog(file):
                if datagram is not None:
                    yield from decoder.decode(datagram.data, datagram.t_recv_ns)


def _from_messages(path: Path, messages: Iterable[Message]) -> Recording:
    """Return the motion of the vehicle that sends most attitudes, by its own stamps."""
    kept = [m for m in messages if isinstance(m, MESSAGE_TYPES)]
    senders = Counter((m.system, m.component) for m in kept if isinstance(m, Attitude))
    if not senders:
        raise LogError(f"{path}: the log has no attitude, which a flight needs")
    ((sender, _),) = senders.most_common(1)
    own = [m for m in kept if (m.system, m.component) == sender]
    stamped = [m for m in own if m.clock is Clock.BOOT]
    at = [m for m in stamped if isinstance(m, LocalPosition)]
    local: Sequence[Sequence[float]] = [(m.t_ns, *m.r_OF_n, *m.v_F_n) for m in at]
    globally = [m for m in stamped if isinstance(m, GlobalPosition)]
    fixes = [m for m in stamped if isinstance(m, GpsFix) and m.fix_type >= MIN_FIX_TYPE]
    places = local or _rows_from_positions(globally) or _rows_from_fixes(fixes)
    newest, arms = 0, []
    for m in own:  # heartbeats have no stamp of their own
        newest = m.t_ns if m.clock is Clock.BOOT else newest
        if isinstance(m, Heartbeat):
            arms.append((newest, float(m.armed)))
    kinds = {m.vehicle_type for m in own if isinstance(m, Heartbeat)}
    return Recording(
        name=path.stem,
        places=_rows(path, "position", places),
        attitudes=_rows(path, "attitude", [(m.t_ns, *m.q_nb) for m in stamped if isinstance(m, Attitude)]),
        forces=_table([(m.t_ns, *m.f_b) for m in stamped if isinstance(m, Imu)], 4),
        arms=_table(arms, 2),
        leader_class="fixed_wing" if FIXED_WING in kinds else "multirotor",
        is_gps=not (local or globally),
    )


def _rows_from_positions(messages: list[GlobalPosition]) -> list[tuple[float, ...]]:
    """Return rows of GLOBAL_POSITION_INT relative to its first position."""
    if not messages:
        return []
    origin = (messages[0].lat_deg, messages[0].lon_deg, messages[0].alt_msl)
    return [(m.t_ns, *ned_from_geodetic((m.lat_deg, m.lon_deg, m.alt_msl), origin), *m.v_F_n) for m in messages]


def _rows_from_fixes(fixes: list[GpsFix]) -> list[tuple[float, ...]]:
    """Return rows of GPS fixes relative to the first one.

    A receiver without a vertical speed gives no velocity.
    """
    if not fixes:
        return []
    origin, rows = (fixes[0].lat_deg, fixes[0].lon_deg, fixes[0].alt_msl), []
    for m in fixes:
        v = (math.nan,) * 3
        if m.ground_speed is not None and m.course_rad is not None and m.v_down is not None:
            v = (m.ground_speed * math.cos(m.course_rad), m.ground_speed * math.sin(m.course_rad), m.v_down)
        rows.append((m.t_ns, *ned_from_geodetic((m.lat_deg, m.lon_deg, m.alt_msl), origin), *v))
    return rows


def _from_csv(path: Path) -> Recording:
    """Return the motion from a .csv."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        missing = [
            name for name in (*POSITION_COLUMNS, *ATTITUDE_COLUMNS) if name not in (reader.fieldnames or ())
        ]
        if missing:
            raise LogError(f"{path}: the table lacks the column(s) {', '.join(missing)}")
        has_velocity = all(name in (reader.fieldnames or ()) for name in VELOCITY_COLUMNS)
        names, rows = (*POSITION_COLUMNS, *(VELOCITY_COLUMNS if has_velocity else ()), *ATTITUDE_COLUMNS), []
        is_fixed_wing = False
        try:
            for row in reader:
                rows.append([float(row[name]) for name in names])
                is_fixed_wing |= row.get("mav_type") == str(FIXED_WING)
        except (TypeError, ValueError) as error:
            raise LogError(f"{path}, line {reader.line_num}: {error}") from error
    table = np.array(rows).reshape(-1, len(names))
    unknown = np.full((len(table), 0 if has_velocity else 3), np.nan)
    places = np.hstack([table[:, : len(names) - 4], unknown])
    attitudes = np.hstack([table[:, :1], table[:, -4:]])
    seconds = 1.0 / S_PER_NS
    places[:, 0] *= seconds
    attitudes[:, 0] *= seconds
    return Recording(
        name=path.stem,
        places=_rows(path, "position", places.tolist()),
        attitudes=_rows(path, "attitude", attitudes.tolist()),
        forces=_table([], 4),
        arms=_table([], 2),
        leader_class="fixed_wing" if is_fixed_wing else "multirotor",
    )


def _rows(path: Path, what: str, rows: Sequence[Sequence[float]]) -> Array:
    """Return the table of these rows; raises LogError if there are fewer than two."""
    table = _table(rows, len(rows[0])) if rows else EMPTY
    if len(table) < 2:
        raise LogError(f"{path}: the log has no {what}, which a flight needs")
    return table


def _table(rows: Sequence[Sequence[float]], columns: int) -> Array:
    """Return the table of these rows, ordered by stamp (ns, converted to s), one row a stamp.

    Rows with values that are not finite are dropped, unless only the velocity is unknown.
    """
    table: Array = np.array(rows, dtype=float).reshape(-1, columns)
    table = table[np.isfinite(table[:, :4]).all(axis=1)]
    table = table[np.unique(table[:, 0], return_index=True)[1]]
    table[:, 0] *= S_PER_NS
    return table


def gaps(t: Array, longest: float) -> list[tuple[float, float]]:
    """Return the intervals between samples at t (n,) that exceed `longest` seconds."""
    return [(a, b) for a, b in pairwise(t.tolist()) if b - a > longest]
