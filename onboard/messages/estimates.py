"""What the estimators say."""

from enum import StrEnum

from onboard.messages.base import ImagePoint, Quaternion, Record, Vec3


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

    @property
    def is_primary(self) -> bool:
        """Whether this is the estimator's one target (the leader, our own state), and not one of many."""
        return self.target == self.name


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


Output = Estimate | OwnPose
