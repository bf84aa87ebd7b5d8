"""Reports and measurements of other aircraft."""

from enum import StrEnum
from typing import Literal

from onboard.messages.base import Clock, Message, Record, Vec3


class AltitudeType(StrEnum):
    """The reference of an ADS-B altitude."""

    PRESSURE = "pressure"  # barometric: above mean sea level as far as the sender's QNH is right
    GEOMETRIC = "geometric"  # GNSS: above the WGS-84 ellipsoid


class AdsbVehicle(Message, frozen=True, kw_only=True):
    """ADSB_VEHICLE: the last report of one aircraft at an ADS-B receiver; fields not marked as valid are None.

    WGS-84 degrees, m, m/s; `course` over ground in rad clockwise from true north, `climb` positive up. `tslc`:
    time since the last reception, in whole seconds; `icao`: the 24-bit address; `emitter`: ADSB_EMITTER_TYPE.
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
    """GLOBAL_POSITION_INT of another vehicle, `system`; fields as in `GlobalPosition`. Its stamp is on the
    other vehicle's boot clock, so its arrival counts as its time."""

    lat_deg: float
    lon_deg: float
    alt_msl: float
    v_n: Vec3


class DistanceReading(Message, frozen=True, kw_only=True):
    """DISTANCE_SENSOR: the range that a rangefinder or a radio measured (m), with its standard deviation if it is
    sent. It is taken as true at its arrival. `sensor`: its id. `distance` is None where it measured nothing."""

    sensor: int
    distance: float | None
    sigma: float | None


class SatelliteRange(Record, frozen=True, kw_only=True):
    """A GNSS receiver's measurement of one satellite: pseudorange (m) and its rate (m/s), with their standard
    deviations if known. Position and velocity of the satellite (m, m/s) are in e at the time of reception. The
    Earth's rotation during the signal's flight, the satellite's clock error and the mean troposphere are
    corrected, as in receivers."""

    satellite: str
    r_e: Vec3
    v_e: Vec3
    pseudorange: float
    rate: float
    sigma: float | None = None
    rate_sigma: float | None = None


class PeerRanges(Message, frozen=True, kw_only=True):
    """One epoch of another vehicle's GNSS receiver. The receiver's clock error is in all its pseudoranges."""

    peer: int
    satellites: tuple[SatelliteRange, ...]


class Pseudoranges(Record, frozen=True, kw_only=True):
    """Pseudoranges that another vehicle, MAVLink system number `peer`, shares, one record per epoch. `t_ns` is the
    time of reception on `clock`."""

    t_ns: int
    clock: Clock
    peer: int
    satellites: tuple[SatelliteRange, ...] = ()


class Collision(Message, frozen=True, kw_only=True):
    """COLLISION: closest approach of a threat. `source`: 0 ADS-B, 1 another vehicle's GLOBAL_POSITION_INT;
    `threat`: its address or system number. `time` in s, distances in m."""

    source: int
    threat: int
    threat_level: int
    time: float
    vertical: float
    horizontal: float


class RadarDetection(Record, frozen=True, kw_only=True):
    """One echo: range (m), azimuth (rad, positive right of the frame's first axis), elevation (rad, positive up),
    their standard deviations, if known, and the signal-to-noise ratio."""

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
    """Output of a radar on our vehicle, one per scan. `t_ns` is the time of the echoes on `clock`. Azimuth and
    elevation refer to our body axes, or to local NED for a levelled radar."""

    t_ns: int
    clock: Clock
    radar: str
    frame: RadarFrame = "body"
    detections: tuple[RadarDetection, ...] = ()
