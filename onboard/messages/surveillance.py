"""What is heard and seen of other traffic."""

from enum import StrEnum
from typing import Literal

from onboard.messages.base import Clock, Message, Record, Vec3


class AltitudeType(StrEnum):
    """What an altitude of ADS-B is measured against."""

    PRESSURE = "pressure"  # barometric: above mean sea level as far as the sender's QNH is right
    GEOMETRIC = "geometric"  # GNSS: above the WGS-84 ellipsoid


class AdsbVehicle(Message, frozen=True, kw_only=True):
    """ADSB_VEHICLE: what an ADS-B receiver last heard of one aircraft; None where it is not marked as valid.

    WGS-84 degrees, m, m/s; `course` over ground in rad clockwise from true north, `climb` positive up. `tslc` is
    the time since it was last heard, in whole seconds; `icao` the 24-bit address; `emitter` ADSB_EMITTER_TYPE.
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
    """GLOBAL_POSITION_INT of another vehicle, `system`; fields as in `GlobalPosition`. Its stamp is of its own
    boot clock, so it counts as true when it arrived."""

    lat_deg: float
    lon_deg: float
    alt_msl: float
    v_n: Vec3


class SatelliteRange(Record, frozen=True, kw_only=True):
    """What a GNSS receiver measured of one satellite: pseudorange (m) and its rate (m/s), with their standard
    deviations if known. Position and velocity of the satellite are in e at the time of reception, with the Earth's
    turn on the signal's way, the satellite's clock and the mean troposphere removed, as receivers do."""

    satellite: str
    r_e: Vec3
    v_e: Vec3
    pseudorange: float
    rate: float
    sigma: float | None = None
    rate_sigma: float | None = None


class PeerRanges(Message, frozen=True, kw_only=True):
    """What another vehicle's GNSS receiver measured at one time, its own clock's error in all of it."""

    peer: int
    satellites: tuple[SatelliteRange, ...]


class Pseudoranges(Record, frozen=True, kw_only=True):
    """What another vehicle, of MAVLink system number `peer`, shares of its GNSS receiver, one per epoch, as JSON:
    `t_ns` is the time of reception, on `clock`."""

    t_ns: int
    clock: Clock
    peer: int
    satellites: tuple[SatelliteRange, ...] = ()


class Collision(Message, frozen=True, kw_only=True):
    """COLLISION: closest approach of a threat. `source` 0 ADS-B, 1 another's GLOBAL_POSITION_INT, with its address
    or system number; s and m."""

    source: int
    threat: int
    threat_level: int
    time: float
    vertical: float
    horizontal: float


class RadarDetection(Record, frozen=True, kw_only=True):
    """One echo: range (m), azimuth (rad, positive right of the frame's first axis), elevation (rad, positive up),
    their standard deviations, if known, and the signal to noise ratio."""

    range: float
    azimuth: float
    elevation: float
    sigma: Vec3 | None = None
    snr_db: float | None = None


RadarFrame = Literal["body", "ned"]  # azimuth from the nose, or from true north with elevation from the horizon


class RadarScan(Message, frozen=True, kw_only=True):
    """All echoes of one moment; none is a scan too."""

    radar: str
    frame: RadarFrame
    detections: tuple[RadarDetection, ...]


class RadarDetections(Record, frozen=True, kw_only=True):
    """What a radar on our vehicle publishes, one per scan, as JSON: `t_ns` is when the echoes came, on `clock`.
    Azimuth and elevation are in our body frame, or in local NED for a radar that levels itself."""

    t_ns: int
    clock: Clock
    radar: str
    frame: RadarFrame = "body"
    detections: tuple[RadarDetection, ...] = ()
