"""Outputs of the estimators."""

from enum import StrEnum

from onboard.messages.base import ImagePoint, Quaternion, Record, Vec3
from onboard.messages.causes import Cause


class Lifecycle(StrEnum):
    """The state of an estimator's track."""

    SEARCHING = "searching"  # no measurement yet, or none for longer than the reset timeout
    INITIALISING = "initialising"  # measurements arrive, but not yet enough that agree
    TRACKING = "tracking"  # the last fused measurement is within the coasting time
    COASTING = "coasting"  # prediction only, within the validity timeout
    LOST = "lost"  # prediction only, beyond the validity timeout: do not use it

    @property
    def is_valid(self) -> bool:
        """Whether an estimate in this state may be used."""
        return self in (Lifecycle.TRACKING, Lifecycle.COASTING)


class Verdict(StrEnum):
    """The result of processing one measurement."""

    FUSED = "fused"
    FUSED_LATE = "fused_late"  # older than the newest fused measurement: fused by rewind and replay
    INITIALISING = "initialising"  # kept, to start a track
    GATED = "gated"  # its NIS exceeds the gate
    DUPLICATE = "duplicate"  # same camera and same time stamp as an earlier measurement
    TOO_OLD = "too_old"  # older than the rewind horizon
    TOO_NEW = "too_new"  # its time is after the present
    NOT_FINITE = "not_finite"  # it contains NaN or infinity
    DEGENERATE = "degenerate"  # geometry that no camera can produce, such as wingtips that coincide
    OUT_OF_VIEW = "out_of_view"  # at or beyond the edge of the image: cut off, or from another camera
    NO_POSE = "no_pose"  # our own pose at its time is unknown
    NUMERICAL = "numerical"  # an update would make the covariance invalid
    STALE = "stale"  # outdated: its sender received the report too long ago, or a camera repeats the same points
    NO_POSITION = "no_position"  # no valid coordinates or altitude
    IMPLAUSIBLE = "implausible"  # farther from its track than an aircraft can fly in the time
    UNASSOCIATED = "unassociated"  # belongs to no track and starts none
    OURSELVES = "ourselves"  # our own transponder
    DIRECTION_ONLY = "direction_only"  # it shows no wing, and a direction alone starts no track
    FULL = "full"  # the maximum number of tracks exists


class MeasurementReport(Record, frozen=True, kw_only=True):
    """One measurement with its prediction, its innovation and the verdict.

    A field is None if the verdict was reached before it could be computed. The components of a box are its middle
    (right and down), its width and its height.

    Attributes
    ----------
    source
        Name of the sensor.
    components, units
        Name and unit of each component of the vectors.
    points, predicted_points
        Image points as in `TargetPoints`.
    misfits
        Named points that were left out because they fit no attitude of the target.
    noise_scale
        Factor on the configured standard deviations, as the estimator has learnt it.
    """

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
    misfits: tuple[str, ...] = ()
    noise_scale: float = 1.0


class ThreatLevel(StrEnum):
    """The danger of another aircraft's closest approach."""

    NONE = "none"
    LOW = "low"  # it may come too close, within the uncertainty
    HIGH = "high"  # it will come too close on its present motion


class ClosestApproach(Record, frozen=True, kw_only=True):
    """The predicted closest approach of another aircraft.

    We are assumed to keep our velocity, and the other aircraft its velocity or its present turn.

    Attributes
    ----------
    time, time_sigma
        Time from the estimate to the closest approach, s, and its standard deviation; 0 if the distance already
        grows.
    distance, distance_sigma
        Distance at that time, m, and its standard deviation.
    horizontal, vertical
        Components of the distance, m; vertical is positive if the other aircraft is above.
    turn_rate
        Turn rate of the other aircraft, rad/s, positive right; 0: straight flight.
    """

    time: float
    time_sigma: float
    distance: float
    distance_sigma: float
    horizontal: float
    vertical: float
    threat: ThreatLevel
    turn_rate: float = 0.0


class Intruder(Record, frozen=True, kw_only=True):
    """Identity, position over ground and closest approach of a traffic track.

    Attributes
    ----------
    sources
        Sensors that have contributed measurements.
    lat_deg, lon_deg, alt_msl
        WGS-84 position, degrees and m above mean sea level.
    v_n
        Velocity over ground in NED, m/s.
    """

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


class Mode(Record, frozen=True, kw_only=True):
    """One of several places where a target may be.

    Attributes
    ----------
    weight
        Probability of this place.
    mean
        The estimate's first six components (6,): relative position (m) and velocity (m/s).
    covariance
        Covariance (6, 6) of `mean`.
    """

    weight: float
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]


class Estimate(Record, frozen=True, kw_only=True):
    """One estimate of one target by one estimator. Use it only if it is `valid`.

    Attributes
    ----------
    reason, cause
        Why the estimate is in its state, for people and for programs.
    frame
        Frame of the vector components.
    components, units
        Name and unit of each component of `mean`.
    mean, covariance
        Mean (n,) and covariance (n, n); None before a track exists.
    age
        Seconds from the last fused measurement to `t_ns`.
    state_since_ns
        Start of the state.
    """

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
    age: float | None
    reset_count: int
    state_since_ns: int = 0
    measurement: MeasurementReport | None = None
    intruder: Intruder | None = None  # for traffic only
    modes: tuple[Mode, ...] = ()  # of the leader, nearest first, where its range is open; else none
    cause: Cause = Cause.NONE

    @property
    def is_primary(self) -> bool:
        """Whether this is the estimator's only target (the leader, our own state), and not one of many."""
        return self.target == self.name


class FaultKind(StrEnum):
    """Kinds of faults of our own vehicle or its sensors."""

    MOTOR = "motor"  # one motor gives less thrust than commanded
    MASS = "mass"  # equal commands give a different lift: hover cannot distinguish mass from weaker motors
    GUST = "gust"  # a sideways disturbance
    OUTLIERS = "outliers"  # a sensor gives single wrong values


class Fault(Record, frozen=True, kw_only=True):
    """A lasting fault of our own vehicle.

    Attributes
    ----------
    part
        The motor ("motor 1"), the sensor ("attitude.roll"), or "".
    magnitude
        In `unit`: the share of thrust lost, the mass as a multiple of the configured one, m/s^2, or wrong values
        per second.
    """

    kind: FaultKind
    part: str
    t_onset_ns: int
    magnitude: float
    unit: str

    @property
    def name(self) -> str:
        """`motor 1`, `gust`, `outliers attitude.roll`."""
        return self.part if self.part.startswith(self.kind) else f"{self.kind} {self.part}".strip()


class NavState(Estimate, frozen=True, kw_only=True):
    """Our own vehicle by our own estimator: position from O, velocity, attitude (ZYX) and body rates.

    The attitude part of `covariance` is that of the rotation vector from the estimate to the truth, rad about b's
    axes.

    Attributes
    ----------
    q_nb, omega_b
        Attitude (body to NED), and body rates, rad/s.
    origin
        The autopilot's origin O, degrees and m above mean sea level.
    layer
        Width of the smoothing boundary layer of each component of the last measurement. An innovation beyond it
        indicates an error of the model.
    switch_fraction
        Share of innovations beyond their layer over the last second.
    nis_ratio
        Mean NIS over its expectation, over the last second.
    quality
        From 1 to 100 %; -1 when not valid.
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
    """Our own vehicle by the autopilot's estimate. `t_ns` is on the boot clock.

    Attributes
    ----------
    r_OF_n
        Position from the autopilot's origin O in NED, m; north and east are None while they are unknown.
    v_F_n, a_F_n
        Velocity and acceleration in NED, m/s and m/s^2.
    q_nb
        Attitude, body to NED.
    """

    t_ns: int
    r_OF_n: tuple[float | None, float | None, float]
    v_F_n: Vec3
    a_F_n: Vec3
    q_nb: Quaternion


Output = Estimate | OwnPose
