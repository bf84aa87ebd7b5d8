"""Where another aircraft reports that it is: position and velocity of its messages, or why they cannot be used."""

import math
from typing import Final, NamedTuple

from onboard.estimators.kit.frame import on_earth
from onboard.messages import AdsbVehicle, AltitudeType, FollowTarget, PeerPosition, Vec3, Verdict

LOWEST: Final = -1000.0  # m
HIGHEST: Final = 30_000.0  # m; no aircraft that flies by lift is higher
NOWHERE: Final = (0.0, 0.0)  # latitude and longitude that a sender without a position reports
STANDSTILL: Final = 1.0  # m/s; below it an aircraft may report the same position twice


class ReportedPosition(NamedTuple):
    """Latitude and longitude in degrees and the height in m above mean sea level; velocity in NED there, m/s; and
    whether its horizontal and its vertical part were reported."""

    place: tuple[float, float, float]
    v: Vec3
    has_level: bool
    has_climb: bool


def of_adsb(
    m: AdsbVehicle, *, geoid_undulation: float, pressure_altitude_offset: float, fastest: float
) -> ReportedPosition | Verdict:
    """What an ADSB_VEHICLE reports. Mean sea level is a GNSS height less the undulation, m, or a pressure altitude
    with the offset, m; `fastest`: m/s."""
    if m.lat_deg is None or m.lon_deg is None or m.altitude is None or (m.lat_deg, m.lon_deg) == NOWHERE:
        return Verdict.NO_POSITION
    speed, course, climb = m.ground_speed, m.course, m.climb
    height = m.altitude
    if m.altitude_type is AltitudeType.GEOMETRIC:
        height -= geoid_undulation
    else:
        height += pressure_altitude_offset
    has_level = speed is not None and course is not None
    along, direction = (speed, course) if speed is not None and course is not None else (0.0, 0.0)
    v = along * math.cos(direction), along * math.sin(direction), -(climb or 0.0)
    reported = ReportedPosition((m.lat_deg, m.lon_deg, height), v, has_level, climb is not None)
    is_possible = 0 < m.icao < 2**24 and is_plausible(reported.place, v, fastest)
    return reported if is_possible else Verdict.IMPLAUSIBLE


def of_peer(m: PeerPosition | FollowTarget, *, fastest: float) -> ReportedPosition | Verdict:
    """What another vehicle's own position message reports; `fastest`: m/s."""
    if (m.lat_deg, m.lon_deg) == NOWHERE:
        return Verdict.NO_POSITION
    reported = ReportedPosition((m.lat_deg, m.lon_deg, m.alt_msl), m.v_n, has_level=True, has_climb=True)
    return reported if is_plausible(reported.place, m.v_n, fastest) else Verdict.IMPLAUSIBLE


def is_plausible(place: tuple[float, float, float], v: Vec3, fastest: float) -> bool:
    """Whether an aircraft can be there and fly so, at `fastest` m/s at most."""
    lat_deg, lon_deg, height = place
    return on_earth(lat_deg, lon_deg) and LOWEST <= height <= HIGHEST and math.hypot(*v) <= fastest


def is_repetition(a: object, b: object) -> bool:
    """Whether a receiver repeats an older report: the same position to the last digit, of an aircraft that
    moves."""
    return (
        isinstance(a, AdsbVehicle)
        and isinstance(b, AdsbVehicle)
        and (a.lat_deg, a.lon_deg, a.altitude) == (b.lat_deg, b.lon_deg, b.altitude)
        and (a.ground_speed or 0.0) > STANDSTILL
    )
