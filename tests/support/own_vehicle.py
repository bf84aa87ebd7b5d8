"""Messages of our own vehicle, without noise by default, and the resulting states."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from onboard.config import parse_config
from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import Attitude, GpsFix, Heartbeat, Imu, Message, NavState
from onboard.pipeline import Pipeline

MS: Final = 1_000_000
ORIGIN: Final = (47.4, 8.5, 500.0)
GRAVITY: Final = 9.80665


def pipeline(**section: Any) -> Pipeline:
    """Return a pipeline with these settings of the own-state estimator, and the GPS delay `gps_s`."""
    delay = {"gps_s": section.pop("gps_s", 0.0)}
    return Pipeline(parse_config({"estimator": {"own_state": section}, "delay": delay}))


def header(t_ms: int, late_ms: float = 1.0) -> dict[str, Any]:
    """The times of a message of t_ms on the boot clock, received late_ms after."""
    return {"t_ns": t_ms * MS, "t_recv_ns": round((t_ms + late_ms) * MS)}


def attitude(t_ms: int, q: Sequence[float] = (1, 0, 0, 0), omega: Sequence[float] = (0, 0, 0)) -> Attitude:
    """An attitude q_nb, turning at omega_b, rad/s."""
    return Attitude(**header(t_ms), q_nb=tuple(map(float, q)), omega_b=tuple(map(float, omega)))


def imu(t_ms: int, f_b: Sequence[float] = (0, 0, -GRAVITY), omega: Sequence[float] = (0, 0, 0)) -> Imu:
    """Specific force, m/s^2, and rates, rad/s, in body axes; by default at rest."""
    return Imu(**header(t_ms), f_b=tuple(map(float, f_b)), omega_b=tuple(map(float, omega)))


def fix(t_ms: int, r: Sequence[float] = (0, 0, 0), v: Sequence[float] = (0, 0), fix_type: int = 3) -> GpsFix:
    """A fix at r, m from ORIGIN in NED, moving over ground at v, m/s north and east."""
    lat, lon, alt = geodetic_from_ned(np.array(r, float), ORIGIN)
    return GpsFix(
        **header(t_ms),
        fix_type=fix_type,
        satellites=12,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt,
        ground_speed=math.hypot(*v[:2]),
        course_rad=math.atan2(v[1], v[0]),
        h_acc=0.5,
        v_acc=1.0,
    )


def heartbeat() -> Heartbeat:
    """An armed multirotor's, of PX4."""
    return Heartbeat(t_ns=0, t_recv_ns=0, vehicle_type=2, autopilot=12, armed=True, status=4)


def states_of(p: Pipeline, messages: Sequence[Message]) -> list[NavState]:
    """Return the own states that the pipeline estimates from these messages."""
    return [o for o in p.advance(messages) if isinstance(o, NavState)]


def hovering(start_ms: int, end_ms: int) -> Iterator[Message]:
    """Level and at rest: IMU and attitude at 100 Hz, fixes at 10 Hz."""
    for t in range(start_ms, end_ms, 10):
        yield imu(t)
        yield attitude(t)
        if t % 100 == 0:
            yield fix(t)
