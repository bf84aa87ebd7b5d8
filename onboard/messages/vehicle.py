"""Messages to and from an autopilot."""

from typing import Final

from onboard.messages.base import Message, Positive, Quaternion, Vec3

TIMESYNC_TAG_NS: Final = 191  # Last three digits of `ts1_ns` in our own TIMESYNC requests.

# Vehicles without aerodynamic lift, by MAV_TYPE.
NOT_LIFTED: Final = {7: "airship", 8: "balloon", 9: "rocket", 10: "rover", 11: "boat", 12: "submarine"}


class Heartbeat(Message, frozen=True, kw_only=True):
    """HEARTBEAT.

    Attributes
    ----------
    vehicle_type, autopilot
        MAV_TYPE and MAV_AUTOPILOT numbers.
    status
        MAV_STATE number.
    custom_mode
        The autopilot's own number of its flight mode.
    """

    vehicle_type: int
    autopilot: int
    armed: bool
    status: int
    custom_mode: int = 0


class CurrentMode(Message, frozen=True, kw_only=True):
    """CURRENT_MODE: the flight mode and the intended mode, numbered as `Heartbeat.custom_mode`.

    Attributes
    ----------
    intended_mode
        The requested mode, to which the vehicle returns as soon as it can; 0: unknown.
    """

    custom_mode: int
    intended_mode: int


class LandedState(Message, frozen=True, kw_only=True):
    """EXTENDED_SYS_STATE: whether the vehicle is on the ground.

    None if the autopilot does not know.
    """

    on_ground: bool | None


class SystemTime(Message, frozen=True, kw_only=True):
    """SYSTEM_TIME: boot time and the autopilot's Unix time (0 if unknown)."""

    unix_ns: int


class TimeSync(Message, frozen=True, kw_only=True):
    """TIMESYNC. `tc1_ns` is 0 in a request; a reply echoes the request's `ts1_ns`."""

    tc1_ns: int
    ts1_ns: int

    @property
    def is_tagged(self) -> bool:
        """Whether the request's time has our tag, see `tagged`."""
        return self.ts1_ns % 1000 == TIMESYNC_TAG_NS


def tagged(now_ns: int) -> int:
    """Return the `ts1_ns` of our own request.

    It is the time to the microsecond, with our tag for nanoseconds.
    """
    return now_ns - now_ns % 1000 + TIMESYNC_TAG_NS


class Attitude(Message, frozen=True, kw_only=True):
    """ATTITUDE_QUATERNION or ATTITUDE: body to NED (Hamilton, scalar first) and body rates, rad/s."""

    q_nb: Quaternion
    omega_b: Vec3


class LocalPosition(Message, frozen=True, kw_only=True):
    """LOCAL_POSITION_NED: the vehicle F relative to its EKF origin O, m and m/s, NED."""

    r_OF_n: Vec3
    v_F_n: Vec3


class EstimatorStatus(Message, frozen=True, kw_only=True):
    """The autopilot's report on its own filter. None: not reported.

    It comes from EKF_STATUS_REPORT, ESTIMATOR_STATUS, or the covariance and reset counter of ODOMETRY.
    """

    horizontal_velocity: bool | None  # whether it is known; not in ArduPilot's constant-position mode
    horizontal_position: bool | None
    is_at_rest: bool = False  # PX4's constant-position mode
    yaw_sigma: float | None = None  # rad
    tilt_sigma: float | None = None  # rad, of roll and pitch; with `yaw_sigma`
    resets: int | None = None  # ODOMETRY only: a count of steps in its state, modulo 256


class GlobalOrigin(Message, frozen=True, kw_only=True):
    """GPS_GLOBAL_ORIGIN: O of the autopilot's local positions, WGS-84 degrees and metres above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_msl: float


class GlobalPosition(Message, frozen=True, kw_only=True):
    """GLOBAL_POSITION_INT: WGS-84 degrees, metres above mean sea level and above home, m/s NED."""

    lat_deg: float
    lon_deg: float
    alt_msl: float
    height: float
    v_F_n: Vec3
    heading_rad: float | None


class GpsFix(Message, frozen=True, kw_only=True):
    """GPS_RAW_INT: a raw fix.

    Attributes
    ----------
    ground_speed, v_down
        m/s; `v_down` is in logs only, since the MAVLink message has none.
    course_rad
        Course over ground.
    h_acc, v_acc
        Horizontal and vertical accuracy, m; None if not given.
    """

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
    """HIGHRES_IMU, SCALED_IMU or RAW_IMU.

    Attributes
    ----------
    f_b, omega_b
        Specific force, m/s^2, and angular rate, rad/s, in the body (FRD).
    pressure_altitude
        The barometer's altitude, m (see `Barometer`), if the message has a new one.
    """

    f_b: Vec3
    omega_b: Vec3
    pressure_altitude: float | None = None


class Barometer(Message, frozen=True, kw_only=True):
    """SCALED_PRESSURE: the altitude of this pressure in the standard atmosphere, m.

    Its error is a slowly changing offset, and some per cent of height if the air is warmer or colder than
    standard.
    """

    pressure_altitude: float


class ActuatorOutputs(Message, frozen=True, kw_only=True):
    """SERVO_OUTPUT_RAW: pulse widths in microseconds, 0 where unused.

    Attributes
    ----------
    port
        0: the main outputs; others: auxiliary ones. Which of them drive the motors differs with autopilot and
        protocol.
    """

    pwm_us: tuple[int, ...]
    port: int = 0


class Battery(Message, frozen=True, kw_only=True):
    """BATTERY_STATUS of the first battery, or SYS_STATUS: its voltage under load, V."""

    voltage_v: Positive


class Command(Message, frozen=True, kw_only=True):
    """COMMAND_LONG or COMMAND_INT: a MAV_CMD number and its seven parameters."""

    target_system: int
    target_component: int
    command: int
    params: tuple[float, float, float, float, float, float, float]


class CommandAck(Message, frozen=True, kw_only=True):
    """COMMAND_ACK: MAV_RESULT of a MAV_CMD; `target_*`: sender of the command."""

    target_system: int
    target_component: int
    command: int
    result: int


class Odometry(Message, frozen=True, kw_only=True):
    """ODOMETRY.

    Attributes
    ----------
    r_OF_n, q_nb
        Position from O in n, m, and attitude.
    v_F_b, omega_b
        Velocity and rates in b.
    pose_covariance, velocity_covariance
        Upper triangles (21,), row by row, of position and rotation, and of velocity and rates.
    quality
        1 to 100 %; -1: not valid.
    """

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
