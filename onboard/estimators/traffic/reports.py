"""What other aircraft say of themselves, made ready to fuse: position and velocity in the tracker's frame, with
their noise, at the time they were true; or why it cannot be used."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.frame import Frame, on_earth
from onboard.estimators.traffic.ranges import solve
from onboard.messages import AdsbVehicle, AltitudeType, PeerPosition, PeerRanges, Verdict

LOWEST: Final = -1000.0  # m
HIGHEST: Final = 30_000.0  # m; nothing that flies by its own wings is beyond
UNKNOWN: Final = 300.0  # m/s: sigma of a velocity that was not said
HALF: Final = 0.5  # s: what an age in whole seconds leaves out on average,
WHOLE: Final = 1 / math.sqrt(12)  # and its sigma
SLOW: Final = 1.0  # m/s; what stands still may say the same twice

VAGUE: Final = 300.0  # m: a fix worse than that begins no track

Key = tuple[str, int]  # ("icao", address) or ("system", number)
Heard = AdsbVehicle | PeerPosition | PeerRanges


class Report(NamedTuple):
    """`y` (6,): r_OT_n and v_T_n, with noise R (6, 6), true at `t_ns`; steadily off by about `bias` (3,), m."""

    key: Key
    t_ns: int
    y: Array
    R: Array
    bias: Array
    message: Heard

    @property
    def source(self) -> str:
        """What brought it."""
        return "adsb" if isinstance(self.message, AdsbVehicle) else _OF_PEERS[type(self.message)]


_OF_PEERS: Final[dict[type, str]] = {PeerPosition: "peer", PeerRanges: "gnss"}


def report_of(m: Heard, frame: Frame, config: Config, near: Array | None = None) -> Report | Verdict:
    """The report in a message; else the reason why there is none. `near`: where its track was then, if any."""
    if not frame.known:
        return Verdict.NO_POSE
    if isinstance(m, PeerRanges):
        return _ranges(m, frame, config, near)
    return _adsb(m, frame, config) if isinstance(m, AdsbVehicle) else _peer(m, frame, config)


def same_again(a: Heard, b: Heard | None) -> bool:
    """Whether a receiver repeats what it had heard before: the same place to the last digit, of what moves."""
    return (
        isinstance(a, AdsbVehicle)
        and isinstance(b, AdsbVehicle)
        and (a.lat_deg, a.lon_deg, a.altitude) == (b.lat_deg, b.lon_deg, b.altitude)
        and (a.ground_speed or 0.0) > SLOW
    )


def _adsb(m: AdsbVehicle, frame: Frame, config: Config) -> Report | Verdict:
    if config.own_icao and m.icao == int(config.own_icao, 16):
        return Verdict.OURSELVES
    if m.tslc > config.max_tslc_s:
        return Verdict.STALE
    if m.lat_deg is None or m.lon_deg is None or m.altitude is None:
        return Verdict.NO_POSITION
    speed, course, climb = m.ground_speed, m.course, m.climb
    height = m.altitude
    if m.altitude_type is AltitudeType.GEOMETRIC:
        height -= config.geoid_undulation_m
    else:
        height += config.pressure_altitude_offset_m
    level = speed is not None and course is not None
    along, direction = (speed, course) if speed is not None and course is not None else (0.0, 0.0)
    v_l = along * math.cos(direction), along * math.sin(direction), -(climb or 0.0)
    if not 0 < m.icao < 2**24 or not _flies(m.lat_deg, m.lon_deg, height, v_l, config):
        return Verdict.IMPLAUSIBLE
    age, unsure = config.adsb_latency_s + m.tslc, config.adsb_latency_sigma_s
    if m.tslc >= 1:
        age, unsure = age + HALF, math.hypot(unsure, WHOLE)
    speeds = config.adsb_velocity_sigma_m_s
    sigma = (
        config.adsb_position_sigma_m,
        config.adsb_altitude_sigma_m,
        speeds if level else UNKNOWN,
        speeds if climb is not None else UNKNOWN,
    )
    t_ns = m.t_ns - round(age * 1e9)
    bias = (config.report_bias_m, config.report_bias_m, config.report_bias_altitude_m)
    return _report(("icao", m.icao), t_ns, (m.lat_deg, m.lon_deg, height), v_l, sigma, bias, unsure, m, frame)


def _peer(m: PeerPosition, frame: Frame, config: Config) -> Report | Verdict:
    if (m.lat_deg, m.lon_deg) == (0.0, 0.0):
        return Verdict.NO_POSITION  # what an autopilot says that does not know it
    if not _flies(m.lat_deg, m.lon_deg, m.alt_msl, m.v_n, config):
        return Verdict.IMPLAUSIBLE
    position, speed = config.peer_position_sigma_m, config.peer_velocity_sigma_m_s
    sigma = (position, position, speed, speed)
    t_ns = m.t_ns - round(config.peer_latency_s * 1e9)
    place = (m.lat_deg, m.lon_deg, m.alt_msl)
    bias = (config.peer_bias_m,) * 3
    return _report(("system", m.system), t_ns, place, m.v_n, sigma, bias, config.peer_latency_sigma_s, m, frame)


def _ranges(m: PeerRanges, frame: Frame, config: Config, near: Array | None) -> Report | Verdict:
    """The fix is above the ellipsoid, where we are above mean sea level: the geoid between is taken off."""
    place = frame.place_in_e(near)
    if place is None or not m.satellites:
        return Verdict.NO_POSITION
    fix = solve(m.satellites, place, config.gnss_range_sigma_m, config.gnss_rate_sigma_m_s)
    y, R = frame.from_e(fix.y, fix.R)
    if near is None and np.trace(R[:3, :3]) > VAGUE**2:
        return Verdict.NO_POSITION
    if not fix.agree:
        return Verdict.IMPLAUSIBLE
    lat_deg, lon_deg, height = frame.geodetic(y[None, :3])[0].tolist()
    height -= config.geoid_undulation_m
    if not _flies(lat_deg, lon_deg, height, tuple(y[3:].tolist()), config):
        return Verdict.IMPLAUSIBLE
    y[:3] = frame.position(lat_deg, lon_deg, height)
    return Report(("system", m.peer), m.t_ns, y, R, np.full(3, config.gnss_bias_m), m)


def _flies(lat_deg: float, lon_deg: float, height: float, v: tuple[float, float, float], config: Config) -> bool:
    return on_earth(lat_deg, lon_deg) and LOWEST <= height <= HIGHEST and math.hypot(*v) <= config.max_speed_m_s


def _report(
    key: Key,
    t_ns: int,
    place: tuple[float, float, float],
    v_l: tuple[float, float, float],
    sigma: tuple[float, float, float, float],
    bias: tuple[float, float, float],
    unsure: float,
    message: Heard,
    frame: Frame,
) -> Report:
    """`sigma`: of horizontal position and height, horizontal and vertical speed; `unsure`: of the age, s, which
    blurs the position along the velocity."""
    R_nl = frame.turn(place[0], place[1])
    v = R_nl @ np.array(v_l)
    horizontal, vertical, level, climb = sigma
    R = np.zeros((6, 6))
    R[:3, :3] = (R_nl * np.array([horizontal, horizontal, vertical]) ** 2) @ R_nl.T + unsure**2 * np.outer(v, v)
    R[3:, 3:] = (R_nl * np.array([level, level, climb]) ** 2) @ R_nl.T
    return Report(key, t_ns, np.concatenate([frame.position(*place), v]), R, np.array(bias), message)
