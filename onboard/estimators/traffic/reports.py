"""Other aircraft's reports, ready to fuse: position and velocity in the tracker's frame with their noise, at the
time at which they were true; or the reason why a message cannot be used."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.frame import Frame, on_earth
from onboard.estimators.traffic.ranges import solve
from onboard.geometry.units import NS_PER_S
from onboard.messages import AdsbVehicle, AltitudeType, PeerPosition, PeerRanges, Verdict

LOWEST: Final = -1000.0  # m
HIGHEST: Final = 30_000.0  # m; no aircraft that flies by lift is higher
UNKNOWN_SPEED_SIGMA: Final = 300.0  # m/s: of a velocity that is not reported
ROUNDED_AGE: Final = 0.5  # s: mean error of an age that is given in whole seconds,
ROUNDED_AGE_SIGMA: Final = 1 / math.sqrt(12)  # and its sigma
STANDSTILL: Final = 1.0  # m/s; below it an aircraft may report the same position twice
VAGUE: Final = 300.0  # m: a fix with a larger error begins no track

Key = tuple[str, int]  # ("icao", address) or ("system", number)
ReportMessage = AdsbVehicle | PeerPosition | PeerRanges
SOURCES: Final[dict[type, str]] = {AdsbVehicle: "adsb", PeerPosition: "peer", PeerRanges: "gnss"}


class Report(NamedTuple):
    """`y` (6,): r_OT_n and v_T_n, with noise R (6, 6), true at `t_ns`; `bias_sigma` (3,), m: standard deviation of
    the position's steady error."""

    key: Key
    t_ns: int
    y: Array
    R: Array
    bias_sigma: Array
    message: ReportMessage

    @property
    def source(self) -> str:
        """The kind of message."""
        return SOURCES[type(self.message)]

    @property
    def adsb(self) -> AdsbVehicle | None:
        """The message, if it is one of ADS-B."""
        return self.message if isinstance(self.message, AdsbVehicle) else None


def make_report(m: ReportMessage, frame: Frame, config: Config, near: Array | None = None) -> Report | Verdict:
    """The report in a message; else the reason why there is none. `near`: r_OT_n (3,) of its track at the time, if
    there is one."""
    if not frame.known:
        return Verdict.NO_POSE
    if isinstance(m, PeerRanges):
        return _from_ranges(m, frame, config, near)
    return _from_adsb(m, frame, config) if isinstance(m, AdsbVehicle) else _from_peer(m, frame, config)


def is_repetition(a: ReportMessage, b: ReportMessage | None) -> bool:
    """Whether a receiver repeats an older report: the same position to the last digit, of an aircraft that
    moves."""
    return (
        isinstance(a, AdsbVehicle)
        and isinstance(b, AdsbVehicle)
        and (a.lat_deg, a.lon_deg, a.altitude) == (b.lat_deg, b.lon_deg, b.altitude)
        and (a.ground_speed or 0.0) > STANDSTILL
    )


def _from_adsb(m: AdsbVehicle, frame: Frame, config: Config) -> Report | Verdict:
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
    if not 0 < m.icao < 2**24 or not _is_plausible(m.lat_deg, m.lon_deg, height, v_l, config):
        return Verdict.IMPLAUSIBLE
    age, age_sigma = config.adsb_latency_s + m.tslc, config.adsb_latency_sigma_s
    if m.tslc >= 1:
        age, age_sigma = age + ROUNDED_AGE, math.hypot(age_sigma, ROUNDED_AGE_SIGMA)
    sigma = (
        config.adsb_position_sigma_m,
        config.adsb_altitude_sigma_m,
        config.adsb_velocity_sigma_m_s if level else UNKNOWN_SPEED_SIGMA,
        config.adsb_velocity_sigma_m_s if climb is not None else UNKNOWN_SPEED_SIGMA,
    )
    t_ns = m.t_ns - round(age * NS_PER_S)
    bias = (config.report_bias_m, config.report_bias_m, config.report_bias_altitude_m)
    return _report(("icao", m.icao), t_ns, (m.lat_deg, m.lon_deg, height), v_l, sigma, bias, age_sigma, m, frame)


def _from_peer(m: PeerPosition, frame: Frame, config: Config) -> Report | Verdict:
    if (m.lat_deg, m.lon_deg) == (0.0, 0.0):
        return Verdict.NO_POSITION  # what an autopilot without a position reports
    if not _is_plausible(m.lat_deg, m.lon_deg, m.alt_msl, m.v_n, config):
        return Verdict.IMPLAUSIBLE
    position, speed = config.peer_position_sigma_m, config.peer_velocity_sigma_m_s
    sigma = (position, position, speed, speed)
    t_ns = m.t_ns - round(config.peer_latency_s * NS_PER_S)
    place = (m.lat_deg, m.lon_deg, m.alt_msl)
    bias = (config.peer_bias_m,) * 3
    return _report(("system", m.system), t_ns, place, m.v_n, sigma, bias, config.peer_latency_sigma_s, m, frame)


def _from_ranges(m: PeerRanges, frame: Frame, config: Config, near: Array | None) -> Report | Verdict:
    """The fix is above the ellipsoid, our own height above mean sea level: the geoid's height is subtracted."""
    place = frame.ecef(near)
    if place is None or not m.satellites:
        return Verdict.NO_POSITION
    fix = solve(m.satellites, place, config.gnss_range_sigma_m, config.gnss_rate_sigma_m_s)
    y, R = frame.from_ecef(fix.y, fix.R)
    if near is None and np.trace(R[:3, :3]) > VAGUE**2:
        return Verdict.NO_POSITION
    if not fix.agree:
        return Verdict.IMPLAUSIBLE
    lat_deg, lon_deg, height = frame.geodetic(y[None, :3])[0].tolist()
    height -= config.geoid_undulation_m
    if not _is_plausible(lat_deg, lon_deg, height, tuple(y[3:].tolist()), config):
        return Verdict.IMPLAUSIBLE
    y[:3] = frame.position(lat_deg, lon_deg, height)
    return Report(("system", m.peer), m.t_ns, y, R, np.full(3, config.gnss_bias_m), m)


def _is_plausible(
    lat_deg: float, lon_deg: float, height: float, v: tuple[float, float, float], config: Config
) -> bool:
    return on_earth(lat_deg, lon_deg) and LOWEST <= height <= HIGHEST and math.hypot(*v) <= config.max_speed_m_s


def _report(
    key: Key,
    t_ns: int,
    place: tuple[float, float, float],
    v_l: tuple[float, float, float],
    sigma: tuple[float, float, float, float],
    bias_sigma: tuple[float, float, float],
    age_sigma: float,
    message: ReportMessage,
    frame: Frame,
) -> Report:
    """`sigma`: of horizontal position and height, horizontal and vertical speed; `age_sigma`: of the age, s, which
    blurs the position along the velocity."""
    R_nl = frame.rotation_nl(place[0], place[1])
    v = R_nl @ np.array(v_l)
    horizontal, vertical, level, climb = sigma
    R = np.zeros((6, 6))
    R[:3, :3] = (R_nl * np.array([horizontal, horizontal, vertical]) ** 2) @ R_nl.T + age_sigma**2 * np.outer(v, v)
    R[3:, 3:] = (R_nl * np.array([level, level, climb]) ** 2) @ R_nl.T
    return Report(key, t_ns, np.concatenate([frame.position(*place), v]), R, np.array(bias_sigma), message)
