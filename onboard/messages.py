"""Every typed record that crosses a boundary: between stages, processes, or the wire and the filters.

Records are frozen and keyword-only, hold tuples rather than arrays, and are SI throughout. Frames stand in
the names (see `onboard.geometry`). `t_ns` is when a thing was TRUE: as decoded, on the clock that stamped it
(`clock`); after `onboard.clocks`, on the autopilot's boot clock, the one time base of the program.
`t_recv_ns` is when its bytes arrived, on this computer's clock. Both are integer nanoseconds.
"""

from enum import StrEnum
from typing import Annotated, Literal

import msgspec

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
ImagePoint = tuple[float, float]
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all boundary records."""


class Clock(StrEnum):
    """Which clock stamped a message."""

    BOOT = "boot"  # the autopilot's time since boot
    HOST = "host"  # this computer's clock, the one that also stamps arrivals
    NONE = "none"  # not stamped: true when it arrived, as nearly as we know


class Encoding(StrEnum):
    """How a link's bytes are to be read."""

    MAVLINK = "mavlink"  # whole MAVLink frames in each datagram (UDP, .tlog)
    MAVLINK_STREAM = "mavlink_stream"  # MAVLink frames cut anywhere (TCP, serial)
    POINTS = "points"  # one JSON `CameraPoints` (Zenoh)
    RADAR = "radar"  # one JSON `RadarDetections` (Zenoh)
    RANGES = "ranges"  # one JSON `Pseudoranges` (Zenoh)


class Datagram(Record, frozen=True, kw_only=True):
    """Bytes as they arrived on a link; what a recording holds."""

    channel: str
    encoding: Encoding
    t_recv_ns: int
    data: bytes


# ---------------------------------------------------------------------------------- from the vehicle


class Message(Record, frozen=True, kw_only=True):
    """What every decoded message carries: its times and its sender."""

    t_ns: int
    t_recv_ns: int
    clock: Clock = Clock.BOOT
    system: int = 1
    component: int = 1


class Heartbeat(Message, frozen=True, kw_only=True):
    """HEARTBEAT. `vehicle_type` and `autopilot` are MAV_TYPE and MAV_AUTOPILOT numbers."""

    vehicle_type: int
    autopilot: int
    armed: bool
    status: int


class SystemTime(Message, frozen=True, kw_only=True):
    """SYSTEM_TIME: boot time beside the autopilot's idea of Unix time (0 when unknown)."""

    unix_ns: int


class TimeSync(Message, frozen=True, kw_only=True):
    """TIMESYNC. `tc1_ns` is 0 in a request; a reply echoes the request's `ts1_ns`."""

    tc1_ns: int
    ts1_ns: int


class Attitude(Message, frozen=True, kw_only=True):
    """ATTITUDE_QUATERNION or ATTITUDE: body to NED (Hamilton, scalar first) and body rates, rad/s."""

    q_nb: Quaternion
    omega_b: Vec3


class LocalPosition(Message, frozen=True, kw_only=True):
    """LOCAL_POSITION_NED: the vehicle F relative to its EKF origin O, m and m/s, NED."""

    r_OF_n: Vec3
    v_F_n: Vec3


class GlobalPosition(Message, frozen=True, kw_only=True):
    """GLOBAL_POSITION_INT: WGS-84 degrees, metres above mean sea level and above home, m/s NED."""

    lat_deg: float
    lon_deg: float
    alt_msl: float
    height: float
    v_F_n: Vec3
    heading_rad: float | None


class GpsFix(Message, frozen=True, kw_only=True):
    """GPS_RAW_INT: a raw fix. Speeds in m/s, course in rad, accuracies in m (None when not given); `v_down` only
    from logs, MAVLink's message has none."""

    fix_type: int
    satellites: int | None
    lat_deg: float
    lon_deg: float
    alt_msl: float
    ground_speed: float | None
    course_rad: float | None
    h_acc: float | None
    v_acc: float | None
    v_down: float | None = None


class Imu(Message, frozen=True, kw_only=True):
    """HIGHRES_IMU, SCALED_IMU or RAW_IMU: specific force (m/s^2) and angular rate (rad/s), body FRD; where the
    message has a new one, the barometer's altitude (m, see `Barometer`)."""

    f_b: Vec3
    omega_b: Vec3
    pressure_altitude: float | None = None


class Barometer(Message, frozen=True, kw_only=True):
    """SCALED_PRESSURE: the altitude that has this pressure in the standard atmosphere, m. Off by a slowly changing
    offset, and by per cents where the air is warmer or colder than the standard's."""

    pressure_altitude: float


class ActuatorOutputs(Message, frozen=True, kw_only=True):
    """SERVO_OUTPUT_RAW: pulse widths in microseconds, 0 where unused."""

    pwm_us: tuple[int, ...]


class TargetPoints(Message, frozen=True, kw_only=True):
    """Three points of one aircraft in one image.

    Each point is (Y_c/X_c, Z_c/X_c): position in the image plane of a pinhole camera with unit focal length,
    lens distortion removed, positive right and positive down. `sigma` holds, for the center, left and right
    point, the standard deviation of each coordinate in the same unit; None: the configured pixel noise.
    `target` is empty where the vision process does not tell one aircraft from another. `half_view` is how far the
    image reaches right and down from its axis; None: as configured.
    """

    camera: str
    target: str = "leader"
    center: ImagePoint
    left: ImagePoint
    right: ImagePoint
    sigma: Vec3 | None = None
    half_view: ImagePoint | None = None


class Pixel(Record, frozen=True, kw_only=True):
    """A labelled point in an image: u right, v down, pixels; `sigma_px` of each coordinate if known."""

    u_px: float
    v_px: float
    sigma_px: float | None = None


class Intrinsics(Record, frozen=True, kw_only=True):
    """Pinhole intrinsics in pixels, of the image the pixels are given in (already undistorted)."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


class CameraPoints(Record, frozen=True, kw_only=True):
    """What a vision process publishes, one per image, as JSON: `t_ns` is the time of exposure on `clock`."""

    t_ns: int
    clock: Clock
    camera: str
    intrinsics: Intrinsics
    center: Pixel
    left: Pixel
    right: Pixel
    target: str = "leader"


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


class Command(Message, frozen=True, kw_only=True):
    """COMMAND_LONG or COMMAND_INT: a MAV_CMD number and its seven parameters."""

    target_system: int
    target_component: int
    command: int
    params: tuple[float, float, float, float, float, float, float]


class CommandAck(Message, frozen=True, kw_only=True):
    """COMMAND_ACK: MAV_RESULT of a MAV_CMD; `target_*` is who had asked."""

    target_system: int
    target_component: int
    command: int
    result: int


class Odometry(Message, frozen=True, kw_only=True):
    """ODOMETRY: position from O in n and attitude, velocity and rates in b; covariances (21) are upper triangles,
    row by row, of position and rotation, and of velocity and rates. `quality`: -1 not valid, 1 to 100 %."""

    r_OF_n: Vec3
    q_nb: Quaternion
    v_F_b: Vec3
    omega_b: Vec3
    pose_covariance: tuple[float, ...]
    velocity_covariance: tuple[float, ...]
    reset_counter: int
    quality: int


class StatusText(Message, frozen=True, kw_only=True):
    """STATUSTEXT: severity (0 emergency .. 7 debug) and text."""

    severity: int
    text: str


# ------------------------------------------------------------------------------------- to the outside


class Lifecycle(StrEnum):
    """What an estimator is doing."""

    SEARCHING = "searching"  # nothing seen yet, or nothing for longer than the reset timeout
    INITIALISING = "initialising"  # images seen, not yet enough that agree
    TRACKING = "tracking"  # fused within the coasting time
    COASTING = "coasting"  # predicting; still within the validity timeout
    LOST = "lost"  # predicting beyond the validity timeout: not to be used


class Verdict(StrEnum):
    """What became of one measurement, and why."""

    FUSED = "fused"
    FUSED_LATE = "fused_late"  # older than a measurement fused before it: rewound and replayed
    INITIALISING = "initialising"  # held, to start a track
    GATED = "gated"  # its NIS exceeds the gate
    DUPLICATE = "duplicate"  # same camera, same time stamp as one fused before
    TOO_OLD = "too_old"  # older than the rewind horizon
    TOO_NEW = "too_new"  # stamped after now
    NOT_FINITE = "not_finite"  # NaN or infinity in it
    DEGENERATE = "degenerate"  # geometry no camera gives, such as wingtips that coincide
    OUT_OF_VIEW = "out_of_view"  # at or beyond the image's edge: cut off, or not of this camera
    NO_POSE = "no_pose"  # our own pose at its time is not known
    NUMERICAL = "numerical"  # the filter could not use it without losing its covariance
    STALE = "stale"  # old news: its sender had not heard for too long, or a camera hangs and shows the same points
    NO_POSITION = "no_position"  # without valid coordinates or altitude
    IMPLAUSIBLE = "implausible"  # farther from its track than anything flies in the time
    UNASSOCIATED = "unassociated"  # belongs to no track, nor starts one
    OURSELVES = "ourselves"  # our own transponder
    FULL = "full"  # as many tracks as there may be


class MeasurementReport(Record, frozen=True, kw_only=True):
    """What one measurement said, what was expected, and what became of it. Angles in rad, points as in
    `TargetPoints`; fields are None where the verdict was reached before they could be computed."""

    source: str
    t_ns: int
    t_recv_ns: int
    verdict: Verdict
    components: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    measured: tuple[float, ...] | None = None
    predicted: tuple[float, ...] | None = None
    innovation: tuple[float, ...] | None = None
    innovation_sigma: tuple[float, ...] | None = None
    nis: float | None = None
    gate: float | None = None
    points: tuple[ImagePoint, ...] | None = None
    predicted_points: tuple[ImagePoint, ...] | None = None


class ThreatLevel(StrEnum):
    """How near another aircraft is going to come."""

    NONE = "none"
    LOW = "low"  # within its uncertainty it may come too near
    HIGH = "high"  # as things are it will


class ClosestApproach(Record, frozen=True, kw_only=True):
    """The nearest two aircraft come if neither changes its velocity, or if the other goes on with the turn it is
    in (`turn_rate`, rad/s, to the right; 0: straight): in `time` seconds from the estimate's own time (0: they
    part already), at `distance`; each with its standard deviation. `horizontal` and `vertical` are the parts of
    the distance, vertical positive when the other is above."""

    time: float
    time_sigma: float
    distance: float
    distance_sigma: float
    horizontal: float
    vertical: float
    threat: ThreatLevel
    turn_rate: float = 0.0


class Intruder(Record, frozen=True, kw_only=True):
    """What else is known of a track of traffic: who it says it is, what it was seen by, WGS-84 position (degrees,
    m above mean sea level), velocity over ground (NED, m/s), and how near it comes."""

    icao: int | None
    system: int | None
    callsign: str
    squawk: int | None
    emitter: int
    sources: tuple[str, ...]
    lat_deg: float
    lon_deg: float
    alt_msl: float
    v_n: Vec3
    approach: ClosestApproach


class Estimate(Record, frozen=True, kw_only=True):
    """One estimate of one target by one estimator. `mean` and `covariance` are None before a track exists;
    `valid` says whether a consumer may act on it. `frame` is that of the vector components."""

    name: str
    target: str
    sequence: int
    t_ns: int
    state: Lifecycle
    valid: bool
    reason: str
    frame: str
    components: tuple[str, ...]
    units: tuple[str, ...]
    mean: tuple[float, ...] | None
    covariance: tuple[tuple[float, ...], ...] | None
    age: float | None  # seconds from the last fused measurement to t_ns
    reset_count: int
    state_since_ns: int = 0  # when the state began
    measurement: MeasurementReport | None = None
    intruder: Intruder | None = None  # of traffic only


class FaultKind(StrEnum):
    """What is wrong with our own vehicle or its sensors."""

    MOTOR = "motor"  # one motor gives less thrust than it is told to
    MASS = "mass"  # the same commands lift less, or more: another mass, or all motors weaker (hover cannot tell)
    GUST = "gust"  # something pushes sideways
    OUTLIERS = "outliers"  # a sensor tells single wrong values


class Fault(Record, frozen=True, kw_only=True):
    """A fault that lasts. `part`: which motor ("motor 1"), sensor ("attitude.roll"), or ""; `magnitude` in `unit`:
    the share of thrust lost, the mass as a multiple of the known one, m/s^2, or wrong values a second."""

    kind: FaultKind
    part: str
    t_onset_ns: int
    magnitude: float
    unit: str


class NavState(Estimate, frozen=True, kw_only=True):
    """Our own vehicle by our own estimator: position from O, velocity, attitude (ZYX), body rates. In `covariance`
    the attitude's part is of the rotation, rad about b's axes, that takes the estimate to the truth.

    `layer`: how far each component of the last measurement might have been off, before the filter holds its model
    wrong; `switch_fraction`: how often one was, over the last second, which measures the model's error;
    `nis_ratio`: mean NIS over its expectation, over the same. `quality`: 1 to 100 %, -1 when not valid. `origin`:
    O, degrees and m above mean sea level.
    """

    q_nb: Quaternion | None
    omega_b: Vec3 | None
    origin: Vec3 | None
    layer: tuple[float, ...] | None
    switch_fraction: float | None
    nis_ratio: float | None
    quality: int
    faults: tuple[Fault, ...] = ()


class OwnPose(Record, frozen=True, kw_only=True):
    """Our own vehicle as the autopilot sees it, on the one time base: NED from its EKF origin."""

    t_ns: int
    r_OF_n: Vec3
    v_F_n: Vec3
    a_F_n: Vec3
    q_nb: Quaternion


class StreamHealth(Record, frozen=True, kw_only=True):
    """One message stream: how many, how often (Hz, over the last seconds), how long ago (s)."""

    count: int
    rate: float
    age: float


class SinkHealth(Record, frozen=True, kw_only=True):
    """One sink: records handed on, dropped because its queue was full, restarts after a failure."""

    sent: int = 0
    dropped: int = 0
    restarts: int = 0
    error: str = ""


class Health(Record, frozen=True, kw_only=True):
    """How the program itself is doing. `clock_offset_ns` is host clock minus boot clock; `faults` are those of our
    own vehicle that last."""

    t_ns: int
    t_recv_ns: int
    uptime: float
    autopilot: str
    autopilot_reboots: int
    clock_source: str
    clock_offset_ns: int | None
    round_trip: float | None
    streams: dict[str, StreamHealth]
    states: dict[str, Lifecycle]
    verdicts: dict[str, int]
    rejected: dict[str, int]
    sinks: dict[str, SinkHealth]
    faults: tuple[Fault, ...] = ()


class Truth(Record, frozen=True, kw_only=True):
    """What a simulator knows and an estimator never may. Boot clock; NED; the leader relative to the
    follower, the size (wingspan, m), Oh & Johnson's a_lat and a_long (m/s^2), and both absolute poses."""

    t_ns: int
    r_FL_n: Vec3
    v_FL_n: Vec3
    size: float
    a_lat: float
    a_long: float
    r_OF_n: Vec3
    v_F_n: Vec3
    a_F_n: Vec3
    q_nF: Quaternion
    r_OL_n: Vec3
    q_nL: Quaternion
    omega_b: Vec3 = (0.0, 0.0, 0.0)  # of the follower
    fault: str = ""  # what is wrong with the follower, "" when nothing is


class IntruderTruth(Record, frozen=True, kw_only=True):
    """One aircraft of a simulated traffic, relative to us, NED where we are. `detections` counts what the radar
    has seen of it so far, `messages` what it has said and was received."""

    name: str
    target: str
    r_FT_n: Vec3
    v_FT_n: Vec3
    messages: int
    detections: int


class TrafficTruth(Record, frozen=True, kw_only=True):
    """All simulated traffic at one time, on the boot clock."""

    t_ns: int
    intruders: tuple[IntruderTruth, ...]


class SimStatus(Record, frozen=True, kw_only=True):
    """What a simulator has sent so far, so that losses can be counted: images by camera, frames by name."""

    t_ns: int
    images: int
    frames: int
    finished: bool


Output = Estimate | OwnPose
