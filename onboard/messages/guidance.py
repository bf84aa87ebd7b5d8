"""The leader in absolute terms, and the messages that tell autopilots and ground stations of it."""

from onboard.messages.base import Message, Quaternion, Record, Vec3
from onboard.messages.causes import Cause
from onboard.messages.estimates import Lifecycle


class LeaderState(Record, frozen=True, kw_only=True):
    """The leader in absolute terms, ready to be flown on. It is predicted to `t_ns` (boot clock), which is
    `t_host_ns` on the wall clock of the daemon's computer. Position from the autopilot's origin O, velocity and
    acceleration (m, m/s, m/s^2, NED); `covariance` (6, 6) of position and velocity includes the errors of our
    own. `r_FL_n`: from us to the leader; `r_FL_covariance` (3, 3) lacks the error of our own position. WGS-84
    degrees and metres above mean sea level, where O is known. `course` (rad): the last one of a leader that
    hovers, None before it has flown. `age`: seconds from the last fused image to `t_ns`. If it is not `valid`,
    `reason` says why, and `cause` for programs; the vectors are then those of an estimate that is withheld,
    with wider sigmas, while the leader is in the image, else None. Use them only where nothing depends on the
    range, as to keep the leader in the image."""

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
    """FOLLOW_TARGET: WGS-84 degrees and metres above mean sea level, velocity and acceleration in n, the attitude
    (None: not sent), and the standard deviations of the position, m."""

    lat_deg: float
    lon_deg: float
    alt_msl: float
    v_n: Vec3
    q_nL: Quaternion | None
    position_sigma: Vec3
    a_n: Vec3 | None = None


class Setpoint(Message, frozen=True, kw_only=True):
    """SET_POSITION_TARGET_LOCAL_NED with every field in use: where the vehicle is to be, from O, how it is to move
    there, and its heading (m, m/s, m/s^2, rad, rad/s, n)."""

    target_system: int
    target_component: int
    r_OF_n: Vec3
    v_F_n: Vec3
    a_F_n: Vec3
    yaw: float
    yaw_rate: float


class TargetRelative(Message, frozen=True, kw_only=True):
    """TARGET_RELATIVE in a NED frame that travels with us. `unix_ns`: Unix time; standard deviations in m and rad;
    `q_nL`: attitude of the leader."""

    unix_ns: int
    r_FL_n: Vec3
    position_sigma: Vec3
    yaw_sigma: float
    q_nL: Quaternion


class LandingTarget(Message, frozen=True, kw_only=True):
    """LANDING_TARGET with a valid position: from us in the body (FRD), or from O in NED if `is_local`. `angles` to
    the right and below the body's forward axis, rad; `distance` in m; angular `size`, rad."""

    r: Vec3
    is_local: bool
    angles: tuple[float, float]
    distance: float
    size: float


class CameraTracking(Message, frozen=True, kw_only=True):
    """CAMERA_TRACKING_IMAGE_STATUS: whether the camera's target is tracked, and its place and radius as shares of
    the image's width and height, None while it should be outside the view."""

    is_active: bool
    point: tuple[float, float] | None = None
    radius: float | None = None


class CameraTrackingGeo(Message, frozen=True, kw_only=True):
    """CAMERA_TRACKING_GEO_STATUS: where the camera's target is. None where it is not known. `heading`: direction
    from us, rad from north."""

    is_active: bool
    position: Vec3 | None = None  # degrees, degrees, m above mean sea level
    h_acc: float | None = None
    v_acc: float | None = None
    v_n: Vec3 | None = None
    v_acc_m_s: float | None = None
    distance: float | None = None
    heading: float | None = None


class MessageInterval(Message, frozen=True, kw_only=True):
    """MESSAGE_INTERVAL: how often a message is sent, us; -1: not sent."""

    number: int
    interval_us: int
