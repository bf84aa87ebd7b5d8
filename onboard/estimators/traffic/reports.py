"""Reports of other aircraft, ready to fuse, or the reasons why a message cannot be used.

They are position and velocity in the tracker's frame with their noise, at the time at which they were true.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.frame import Frame
from onboard.estimators.kit.peer_position import ReportedPosition, is_plausible, of_adsb, of_peer
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.pseudoranges import solve
from onboard.messages import AdsbVehicle, AltitudeType, PeerPosition, PeerRanges, Verdict
from onboard.units import NS_PER_S

UNKNOWN_SPEED_SIGMA_M_S: Final = 300.0  # of an unreported velocity
ROUNDING_BIAS_S: Final = 0.5  # mean error of an age in whole seconds
ROUNDING_SIGMA_S: Final = 1 / math.sqrt(12)  # standard deviation of such an age
WEATHER_SIGMA_M: Final = 100.0  # of a pressure altitude, whose sea level is standard: about 12 hPa
MAX_FIX_SIGMA_M: Final = 300.0  # A less certain fix starts no track.

Key = tuple[str, int]  # ("icao", address) or ("system", number)
ReportMessage = AdsbVehicle | PeerPosition | PeerRanges
SOURCES: Final[dict[type, str]] = {AdsbVehicle: "adsb", PeerPosition: "peer", PeerRanges: "gnss"}


class Report(NamedTuple):
    """A report of one aircraft, true at `t_ns`.

    Attributes
    ----------
    y, R
        r_OT_n and v_T_n, (6,), and their noise (6, 6).
    bias_sigma
        Standard deviation (3,) of the position's steady error, m.
    """

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
    """Return the report in a message, or the verdict on an unusable one.

    `near`: r_OT_n (3,) of its track at the time, if there is one.
    """
    if not frame.known:
        return Verdict.NO_POSE
    if isinstance(m, PeerRanges):
        return _from_ranges(m, frame, config, near)
    return _from_adsb(m, frame, config) if isinstance(m, AdsbVehicle) else _from_peer(m, frame, config)


def _from_adsb(m: AdsbVehicle, frame: Frame, config: Config) -> Report | Verdict:
    if config.own_icao and m.icao == int(config.own_icao, 16):
        return Verdict.OURSELVES
    if m.tslc > config.max_tslc_s:
        return Verdict.STALE
    offset, bias_altitude = config.pressure_altitude_offset_m, config.report_bias_altitude_m
    if m.altitude_type is AltitudeType.PRESSURE and not offset:
        measured = frame.pressure_altitude_offset
        offset, bias_altitude = (0.0, WEATHER_SIGMA_M) if measured is None else (measured, bias_altitude)
    reported = of_adsb(
        m,
        geoid_undulation=config.geoid_undulation_m,
        pressure_altitude_offset=offset,
        fastest=config.max_speed_m_s,
    )
    if isinstance(reported, Verdict):
        return reported
    age, age_sigma = config.adsb_latency_s + m.tslc, config.adsb_latency_sigma_s
    if m.tslc >= 1:
        age, age_sigma = age + ROUNDING_BIAS_S, math.hypot(age_sigma, ROUNDING_SIGMA_S)
    sigma = (
        config.adsb_position_sigma_m,
        config.adsb_altitude_sigma_m,
        config.adsb_velocity_sigma_m_s if reported.has_level else UNKNOWN_SPEED_SIGMA_M_S,
        config.adsb_velocity_sigma_m_s if reported.has_climb else UNKNOWN_SPEED_SIGMA_M_S,
    )
    t_ns = m.t_ns - round(age * NS_PER_S)
    bias = (config.report_bias_m, config.report_bias_m, bias_altitude)
    return _report(("icao", m.icao), t_ns, reported, sigma, bias, age_sigma, m, frame)


def _from_peer(m: PeerPosition, frame: Frame, config: Config) -> Report | Verdict:
    reported = of_peer(m, fastest=config.max_speed_m_s)
    if isinstance(reported, Verdict):
        return reported
    position, speed = config.peer_position_sigma_m, config.peer_velocity_sigma_m_s
    sigma = (position, position, speed, speed)
    t_ns = m.t_ns - round(config.peer_latency_s * NS_PER_S)
    bias = (config.peer_bias_m,) * 3
    return _report(("system", m.system), t_ns, reported, sigma, bias, config.peer_latency_sigma_s, m, frame)


def _from_ranges(m: PeerRanges, frame: Frame, config: Config, near: Array | None) -> Report | Verdict:
    """Return the report of pseudoranges.

    The fix is above the ellipsoid, our own height above mean sea level: the geoid's height is subtracted.
    """
    place = frame.ecef(near)
    if place is None or not m.satellites:
        return Verdict.NO_POSITION
    fix = solve(m.satellites, place, config.gnss_range_sigma_m, config.gnss_rate_sigma_m_s)
    y, R = frame.from_ecef(fix.y, fix.R)
    if near is None and np.trace(R[:3, :3]) > MAX_FIX_SIGMA_M**2:
        return Verdict.NO_POSITION
    if not fix.agree:
        return Verdict.IMPLAUSIBLE
    lat_deg, lon_deg, height = frame.geodetic(y[None, :3])[0].tolist()
    height -= config.geoid_undulation_m
    if not is_plausible((lat_deg, lon_deg, height), tuple(y[3:].tolist()), config.max_speed_m_s):
        return Verdict.IMPLAUSIBLE
    y[:3] = frame.position(lat_deg, lon_deg, height)
    return Report(("system", m.peer), m.t_ns, y, R, np.full(3, config.gnss_bias_m), m)


def _report(
    key: Key,
    t_ns: int,
    reported: ReportedPosition,
    sigma: tuple[float, float, float, float],
    bias_sigma: tuple[float, float, float],
    age_sigma: float,
    message: ReportMessage,
    frame: Frame,
) -> Report:
    """Return the report of a position and velocity with their noise.

    `sigma`: of horizontal position and height, horizontal and vertical speed; `age_sigma`: of the age, s, which
    blurs the position along the velocity.
    """
    place = reported.place
    R_nl = frame.rotation_nl(place[0], place[1])
    v = R_nl @ np.array(reported.v)
    horizontal, vertical, level, climb = sigma
    R = np.zeros((6, 6))
    R[:3, :3] = (R_nl * np.array([horizontal, horizontal, vertical]) ** 2) @ R_nl.T + age_sigma**2 * np.outer(v, v)
    R[3:, 3:] = (R_nl * np.array([level, level, climb]) ** 2) @ R_nl.T
    return Report(key, t_ns, np.concatenate([frame.position(*place), v]), R, np.array(bias_sigma), message)
