"""Reports and measurements of other aircraft."""

from enum import StrEnum
from typing import Literal

from onboard.messages.base import Clock, Message, Record, Vec3


class AltitudeType(StrEnum):
    """The reference of an ADS-B altitude."""

    PRESSURE = "pressure"  # barometric: above mean sea level as far as the sender's QNH is right
    GEOMETRIC = "geometric"  # GNSS: above the WGS-84 ellipsoid


class AdsbVehicle(Message, frozen=True, kw_only=True):
    """ADSB_VEHICLE: the last report of one aircraft at an ADS-B receiver.

    Fields not marked as valid are None.

    Attributes
    ----------
    icao
        The 24-bit address.
    lat_deg, lon_deg, altitude
        WGS-84 degrees, and m by `altitude_type`.
    course
        Course over ground, rad clockwise from true north.
    ground_speed, climb
        m/s; `climb` is positive up.
    emitter
        ADSB_EMITTER_TYPE.
    tslc
        Time since the last reception, in whole seconds.
    """

    icao: int
    lat_deg: float | None
    lon_deg: float | None
    altitude: float | None
    altitude_type: AltitudeType
    course: float | None
    ground_speed: float | None
    climb: float | None
    callsign: str = ""
    emitter: int = 0
    tslc: float = 0.0
    squawk: int | None = None
    simulated: bool = False


class PeerPosition(Message, frozen=True, kw_only=True):
    """GLOBAL_POSITION_INT of another vehicle, `system`; fields as in `GlobalPosition`.

    Its stamp is on the other vehicle's boot clock, so its arrival counts as its time.
    """

    lat_deg: float
    lon_deg: float
    alt_msl: float
    v_n: Vec3


class DistanceReading(Message, frozen=True, kw_only=True):
    """DISTANCE_SENSOR: a range measured by a rangefinder or a radio, assumed true at its arrival.

    Attributes
    ----------
    sensor
        Its id.
    distance
        Range, m; None if nothing was measured.
    sigma
        Standard deviation, m, if it is sent.
    """

    sensor: int
    distance: float | None
    sigma: float | None


class SatelliteRange(Record, frozen=True, kw_only=True):
    """A GNSS receiver's measurement of one satellite.

    The Earth's rotation during the signal's flight, the satellite's clock error and the mean troposphere are
    corrected, as in receivers.

    Attributes
    ----------
    r_e, v_e
        Position and velocity of the satellite in e at the time of reception, m and m/s.
    pseudorange, rate
        Pseudorange, m, and its rate, m/s.
    sigma, rate_sigma
        Their standard deviations, if known.
    """

    satellite: str
    r_e: Vec3
    v_e: Vec3
    pseudorange: float
    rate: float
    sigma: float | None = None
    rate_sigma: float | None = None


class PeerRanges(Message, frozen=True, kw_only=True):
    """One epoch of another vehicle's GNSS receiver.

    All its pseudoranges contain the receiver's clock error.
    """

    peer: int
    satellites: tuple[SatelliteRange, ...]


class Pseudoranges(Record, frozen=True, kw_only=True):
    """Pseudoranges shared by another vehicle, one record per epoch.

    Attributes
    ----------
    t_ns
        Time of reception on `clock`.
    peer
        MAVLink system number of the other vehicle.
    """

    t_ns: int
    clock: Clock
    peer: int
    satellites: tuple[SatelliteRange, ...] = ()


class Collision(Message, frozen=True, kw_only=True):
    """COLLISION: the closest approach of a threat.

    Attributes
    ----------
    source
        0: ADS-B; 1: another vehicle's GLOBAL_POSITION_INT.
    threat
        Its address or system number.
    time, vertical, horizontal
        Time in s, distances in m.
    """

    source: int
    threat: int
    threat_level: int
    time: float
    vertical: float
    horizontal: float


class RadarDetection(Record, frozen=True, kw_only=True):
    """One radar echo.

    Attributes
    ----------
    range
        m.
    azimuth
        rad, positive right of the frame's first axis.
    elevation
        rad, positive up.
    sigma
        Standard deviations of range, azimuth and elevation, if known.
    snr_db
        Signal-to-noise ratio, dB.
    """

    range: float
    azimuth: float
    elevation: float
    sigma: Vec3 | None = None
    snr_db: float | None = None


RadarFrame = Literal["body", "ned"]  # azimuth from the nose, or from true north with elevation from the horizon


class RadarScan(Message, frozen=True, kw_only=True):
    """All echoes of one radar scan; there may be none."""

    radar: str
    frame: RadarFrame
    detections: tuple[RadarDetection, ...]


class RadarDetections(Record, frozen=True, kw_only=True):
    """Output of a radar on our vehicle, one record per scan.

    Attributes
    ----------
    t_ns
        Time of the echoes on `clock`.
    frame
        Azimuth and elevation refer to our body axes, or to local NED for a levelled radar.
    """

    t_ns: int
    clock: Clock
    radar: str
    frame: RadarFrame = "body"
    detections: tuple[RadarDetection, ...] = ()
