"""Positions and velocities reported by other aircraft, or why they cannot be used."""

import math
from typing import Final, NamedTuple

from onboard.estimators.kit.frame import NO_POSITION, on_earth
from onboard.messages import AdsbVehicle, AltitudeType, FollowTarget, PeerPosition, Vec3, Verdict

MIN_HEIGHT_M: Final = -1000.0
MAX_HEIGHT_M: Final = 30_000.0  # No aircraft flies by lift above it.
MIN_MOVING_SPEED_M_S: Final = 1.0  # A slower aircraft may report the same position twice.


class ReportedPosition(NamedTuple):
    """The position and velocity of an aircraft by its own message.

    Attributes
    ----------
    place
        Latitude and longitude, degrees, and height above mean sea level, m.
    v
        Velocity in NED there, m/s.
    has_level, has_climb
        Whether the horizontal and the vertical velocity were reported.
    """

    place: tuple[float, float, float]
    v: Vec3
    has_level: bool
    has_climb: bool


def of_adsb(
    m: AdsbVehicle, *, geoid_undulation: float, pressure_altitude_offset: float, fastest: float
) -> ReportedPosition | Verdict:
    """Return the position of an ADSB_VEHICLE, or the verdict on an unusable one.

    Height above mean sea level is a GNSS height minus the undulation, m, or a pressure altitude plus the offset,
    m. `fastest`: maximum plausible speed, m/s.
    """
    if m.lat_deg is None or m.lon_deg is None or m.altitude is None or (m.lat_deg, m.lon_deg) == NO_POSITION:
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
    """Return the position of another vehicle's own message, or the verdict on an unusable one.

    `fastest`: maximum plausible speed, m/s.
    """
    if (m.lat_deg, m.lon_deg) == NO_POSITION:
        return Verdict.NO_POSITION
    reported = ReportedPosition((m.lat_deg, m.lon_deg, m.alt_msl), m.v_n, has_level=True, has_climb=True)
    return reported if is_plausible(reported.place, m.v_n, fastest) else Verdict.IMPLAUSIBLE


def is_plausible(place: tuple[float, float, float], v: Vec3, fastest: float) -> bool:
    """Return whether an aircraft can be at this place with this velocity.

    `fastest`: maximum plausible speed, m/s.
    """
    lat_deg, lon_deg, height = place
    return on_earth(lat_deg, lon_deg) and MIN_HEIGHT_M <= height <= MAX_HEIGHT_M and math.hypot(*v) <= fastest


def is_repetition(a: object, b: object) -> bool:
    """Return whether a moving aircraft's position is the same to the last digit.

    Then a receiver repeats an older report.
    """
    return (
        isinstance(a, AdsbVehicle)
        and isinstance(b, AdsbVehicle)
        and (a.lat_deg, a.lon_deg, a.altitude) == (b.lat_deg, b.lon_deg, b.altitude)
        and (a.ground_speed or 0.0) > MIN_MOVING_SPEED_M_S
    )
