"""The leader's absolute state, and the messages that report it.

Receivers are autopilots and ground stations.
"""

from onboard.messages.base import Message, Quaternion, Record, Vec3
from onboard.messages.causes import Cause
from onboard.messages.estimates import Lifecycle


class LeaderState(Record, frozen=True, kw_only=True):
    """The leader's absolute state, predicted to `t_ns` for use in flight.

    If it is not `valid`, the vectors are those of a withheld estimate with wider sigmas while the leader is in the
    image, and None otherwise. Use them only where nothing depends on the range, as to keep the leader in the
    image.

    Attributes
    ----------
    t_ns, t_host_ns
        The same time on the boot clock and on the wall clock of the daemon's computer.
    reason, cause
        Why the state is not valid, for people and for programs.
    r_OL_n, v_L_n, a_L_n
        Position from the autopilot's origin O, velocity and acceleration in NED, m, m/s and m/s^2.
    covariance
        Covariance (6, 6) of position and velocity, with the errors of our own position and velocity.
    r_FL_n, r_FL_covariance
        Position from us in NED, m, and its covariance (3, 3) without the error of our own position.
    lat_deg, lon_deg, alt_msl
        WGS-84 position, degrees and metres above mean sea level; None while O is unknown.
    course
        Course over ground, rad; while the leader hovers, its last one; None before it has flown.
    size
        Wingspan, m.
    age
        Seconds from the last fused image to `t_ns`.
    """

    t_ns: int
    t_host_ns: int
    sequence: int
    state: Lifecycle
    valid: bool
    reason: str
    r_OL_n: Vec3 | None = None
    v_L_n: Vec3 | None = None
    a_L_n: Vec3 | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None
    r_FL_n: Vec3 | None = None
    r_FL_covariance: tuple[tuple[float, ...], ...] | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_msl: float | None = None
    course: float | None = None
    size: float | None = None
    age: float | None = None
    cause: Cause = Cause.NONE


class FollowTarget(Message, frozen=True, kw_only=True):
    """FOLLOW_TARGET.

    Attributes
    ----------
    lat_deg, lon_deg, alt_msl
        WGS-84 degrees and metres above mean sea level.
    v_n, a_n
        Velocity and acceleration in NED.
    q_nL
        Attitude; None: not sent.
    position_sigma
        Standard deviations of the position, m.
    """

    lat_deg: float
    lon_deg: float
    alt_msl: float
    v_n: Vec3
    q_nL: Quaternion | None
    position_sigma: Vec3
    a_n: Vec3 | None = None


class Setpoint(Message, frozen=True, kw_only=True):
    """SET_POSITION_TARGET_LOCAL_NED with every field in use.

    Attributes
    ----------
    r_OF_n, v_F_n, a_F_n
        Requested position from O, velocity and acceleration in NED, m, m/s and m/s^2.
    yaw, yaw_rate
        Requested heading and its rate, rad and rad/s.
    """

    target_system: int
    target_component: int
    r_OF_n: Vec3
    v_F_n: Vec3
    a_F_n: Vec3
    yaw: float
    yaw_rate: float


class TargetRelative(Message, frozen=True, kw_only=True):
    """TARGET_RELATIVE in a NED frame that travels with us.

    Attributes
    ----------
    unix_ns
        Unix time.
    position_sigma, yaw_sigma
        Standard deviations in m and rad.
    q_nL
        Attitude of the leader.
    """

    unix_ns: int
    r_FL_n: Vec3
    position_sigma: Vec3
    yaw_sigma: float
    q_nL: Quaternion


class LandingTarget(Message, frozen=True, kw_only=True):
    """LANDING_TARGET with a valid position.

    Attributes
    ----------
    r
        Position from us in the body (FRD), or from O in NED if `is_local`, m.
    angles
        Angles to the right of and below the body's forward axis, rad.
    distance, size
        Distance, m, and angular size, rad.
    """

    r: Vec3
    is_local: bool
    angles: tuple[float, float]
    distance: float
    size: float


class CameraTracking(Message, frozen=True, kw_only=True):
    """CAMERA_TRACKING_IMAGE_STATUS: whether the camera's target is tracked, and where it is in the image.

    Attributes
    ----------
    point, radius
        Center and radius as shares of the image's width and height; None while the target is expected outside the
        view.
    """

    is_active: bool
    point: tuple[float, float] | None = None
    radius: float | None = None


class CameraTrackingGeo(Message, frozen=True, kw_only=True):
    """CAMERA_TRACKING_GEO_STATUS: the position of the camera's target.

    None where it is unknown.

    Attributes
    ----------
    heading
        Direction from us to the target, rad from north.
    """

    is_active: bool
    position: Vec3 | None = None  # degrees, degrees, m above mean sea level
    h_acc: float | None = None
    v_acc: float | None = None
    v_n: Vec3 | None = None
    v_acc_m_s: float | None = None
    distance: float | None = None
    heading: float | None = None


class MessageInterval(Message, frozen=True, kw_only=True):
    """MESSAGE_INTERVAL: the interval at which a message is sent, us; -1: not sent."""

    number: int
    interval_us: int
