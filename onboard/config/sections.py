"""Configuration as frozen records, one for each section of the TOML file; keys carry units."""

import math
from typing import Annotated, Any, ClassVar, Final, Literal

import msgspec

from onboard.config.cameras import CameraConfig, camera_inputs, camera_model, mount_errors, name_cameras
from onboard.geometry.camera import Camera
from onboard.messages import (
    Exposure,
    GlobalPosition,
    GpsFix,
    LocalPosition,
    Message,
    NotNegative,
    Positive,
    Record,
    TargetClass,
    Vec3,
)
from onboard.messages.mavlink_enums import ARDUPILOT
from onboard.messages.ros import Ros2Config
from onboard.sinks.zenoh_router import RouterConfig
from onboard.sinks.zenoh_session import ZenohConfig
from onboard.wire.documents.cameras import CameraInput

SystemId = Annotated[int, msgspec.Meta(ge=0, le=255)]


class LinkConfig(Record, frozen=True, kw_only=True):
    """`[[link]]`: a named link.

    Its URL is udpin:HOST:PORT, udpout:, tcp:, tcpin:, serial:DEVICE:BAUD, or json:HOST:PORT for detections.
    """

    name: str
    url: str
    autopilot: bool = True  # heartbeats, TIMESYNC and requests for message rates go out on it; never on json:
    key_file: str | None = None  # of a MAVLink signing key: frames sent are signed, unsigned frames rejected

    @property
    def is_autopilot(self) -> bool:
        """Whether an autopilot may be at its other end."""
        return self.autopilot and not self.url.startswith("json:")

    @property
    def speaks_first(self) -> bool:
        """Whether the other end may wait for a heartbeat before it sends.

        Where we listen, there is no peer yet.
        """
        return self.is_autopilot and not self.url.startswith(("udpin:", "tcpin:"))


class AutopilotConfig(Record, frozen=True, kw_only=True):
    """`[autopilot]`: the autopilot we belong to, and the messages we request from it."""

    system: SystemId = 0  # its MAVLink system id; 0: that of the first autopilot heard
    component: SystemId = 191  # our own component id (MAV_COMP_ID_ONBOARD_COMPUTER)
    trusted: tuple[SystemId, ...] = ()  # systems that may change the rate of messages that move a vehicle
    request_rates: bool = True
    rates_hz: dict[str, float] = msgspec.field(
        default_factory=lambda: {
            "ATTITUDE_QUATERNION": 50.0,
            "LOCAL_POSITION_NED": 50.0,
            "HIGHRES_IMU": 100.0,
            "GLOBAL_POSITION_INT": 10.0,
            "GPS_RAW_INT": 10.0,
        }
    )


class DelayConfig(Record, frozen=True, kw_only=True):
    """`[delay]`: age of each source beyond its stamp, s; None is the autopilot's known delay."""

    local_position_s: float | None = None  # of GLOBAL_POSITION_INT too
    gps_s: float | None = None
    camera_s: float | None = None

    # Withdrawn as keys. No autopilot is known that stamps its attitude or its IMU late. Both positions are of one
    # estimate.
    attitude_s: ClassVar[None] = None
    imu_s: ClassVar[None] = None
    global_position_s: ClassVar[None] = None


class OwnErrors(Record, frozen=True, kw_only=True):
    """`[ownship.errors]`: systematic errors of our autopilot's estimates, one sigma each.

    Every estimator receives them as `own_` and the key, and the leader's include those of the cameras' mounts.
    """

    tilt_sigma_deg: NotNegative = 0.3  # of roll and pitch
    yaw_sigma_deg: NotNegative = 1.0
    velocity_sigma_m_s: NotNegative = 0.1  # on each axis
    position_sigma_m: NotNegative = 1.0  # on each axis

    # Withdrawn as keys: biases of gyroscopes, magnetometers and receivers change over minutes.
    attitude_time_s: ClassVar[float] = 60.0  # correlation time of tilt and yaw
    position_time_s: ClassVar[float] = 60.0  # without effect; older recordings hold it


# Keys that an estimator's section receives from `[target]` and `[ownship.errors]`, and that no file sets there.
DERIVED_KEYS: Final = frozenset(
    {"target", "own_attitude_time_s", *(f"own_{name}" for name in OwnErrors.__struct_fields__)}
)


class OwnshipConfig(Record, frozen=True, kw_only=True):
    """`[ownship]`: source, age and errors of our own state."""

    errors: OwnErrors = OwnErrors()
    # source of attitude and velocity for leader, traffic and outputs; auto: own_state while it is more certain
    source: Literal["autopilot", "own_state", "auto"] = "auto"
    max_age_s: Positive = 0.5  # estimates that rest on older own motion are published as invalid

    # Withdrawn as keys. In 0.1 s a vehicle turns by some degrees. No link delays our own motion by more than 1 s
    # against images.
    max_extrapolation_s: ClassVar[float] = 0.1  # of our own pose beyond its newest sample
    max_lead_s: ClassVar[float] = 1.0  # images stamped farther ahead of our attitude or position are rejected


class OdometryConfig(Record, frozen=True, kw_only=True):
    """`[odometry]`: our own state as MAVLink's ODOMETRY, on one of our links.

    The autopilot whose attitude we use must not fuse it: it would fuse its own estimate.
    """

    link: str | None = None  # its name; None: not sent
    rate_hz: Positive = 30.0


class RecorderConfig(Record, frozen=True, kw_only=True):
    """`[recorder]`: received bytes and every estimate, in an MCAP file."""

    path: str | None = None
    file_mb: Positive | None = None  # size at which a new file begins; None: one file per run
    keep_mb: Positive | None = (
        None  # total size above which the oldest files are removed when one begins; None: never
    )
    keep_days: Positive | None = None  # age above which files are removed


class ParametersConfig(Record, frozen=True, kw_only=True):
    """`[parameters]`: the tunable keys as MAVLink parameters."""

    path: str | None = None  # TOML file of stored values, which override this file; None: read only


class WarmStartConfig(Record, frozen=True, kw_only=True):
    """`[warm_start]`: the state file that lets a restart in flight continue."""

    enabled: bool = True
    path: str | None = None  # of the file; None: one per configuration, in the state folder


class TrafficOutConfig(Record, frozen=True, kw_only=True):
    """`[traffic_out]`: traffic tracks as MAVLink messages on one link; none without `link`."""

    link: str = ""  # its name
    adsb_vehicle: Literal["all", "silent", "none"] = "silent"  # tracks to send; silent: without a transponder
    collision: bool = True  # threats
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0  # of each track


LeaderMessage = Literal[
    "SET_POSITION_TARGET_LOCAL_NED",
    "FOLLOW_TARGET",
    "GLOBAL_POSITION_INT",
    "TARGET_RELATIVE",
    "LANDING_TARGET",
    "ADSB_VEHICLE",
    "CAMERA_TRACKING_IMAGE_STATUS",
    "CAMERA_TRACKING_GEO_STATUS",
]
MAX_OUT_RATE_HZ: Final = 50.0  # the daemon checks for due messages at this rate
OutRate = Annotated[float, msgspec.Meta(gt=0, le=MAX_OUT_RATE_HZ)]


class LeaderOutConfig(Record, frozen=True, kw_only=True):
    """`[[leader_out]]`: the leader as MAVLink messages on one link.

    SET_POSITION_TARGET_LOCAL_NED leads the autopilot on that link. FOLLOW_TARGET and GLOBAL_POSITION_INT have a
    system id of their own, since an autopilot does not follow its own system.
    """

    link: str  # its name
    rates_hz: dict[LeaderMessage, OutRate] = msgspec.field(default_factory=lambda: {"FOLLOW_TARGET": 20.0})
    system: Annotated[int, msgspec.Meta(ge=1, le=254)] = 200  # of the leader in FOLLOW_TARGET: FOLL_SYSID
    camera_component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 100  # sends CAMERA_TRACKING_*; a free one
    # Withdrawn as a key: the leader's system has no other component.
    component: ClassVar[int] = 191  # of the leader


class GuidanceConfig(Record, frozen=True, kw_only=True):
    """`[guidance]`: how SET_POSITION_TARGET_LOCAL_NED leads the autopilot behind the leader."""

    slot_m: Vec3 = (-30.0, 0.0, 3.0)  # from the leader: forward along its course, right, down
    min_distance_m: Positive | None = (
        None  # no approach nearer to where the leader may be; None: 85 % of the slot's
    )
    min_height_m: float = 5.0  # above the origin of the autopilot's local frame, about where it took off
    max_speed_m_s: Positive = 12.0  # horizontal; a lower limit of the autopilot counts
    max_closing_speed_m_s: Positive = 6.0  # of the distance
    max_acceleration_m_s2: Positive = 3.0  # horizontal; a lower limit of the autopilot counts


class Config(Record, frozen=True, kw_only=True):
    """The whole configuration of daemon and replay; `estimator` holds each estimator's Config."""

    link: tuple[LinkConfig, ...] = (
        LinkConfig(name="autopilot", url="udpin:127.0.0.1:14540"),
        LinkConfig(name="camera", url="udpin:127.0.0.1:14560", autopilot=False),
    )
    autopilot: AutopilotConfig = AutopilotConfig()
    camera: CameraConfig = CameraConfig()
    cameras: dict[str, CameraConfig] = msgspec.field(default_factory=dict)  # further ones, by name
    target: dict[str, TargetClass] = msgspec.field(default_factory=dict)  # classes of targets, by name
    delay: DelayConfig = DelayConfig()
    ownship: OwnshipConfig = OwnshipConfig()
    estimator: dict[str, Any] = msgspec.field(default_factory=dict)
    zenoh: ZenohConfig = ZenohConfig()
    router: RouterConfig = RouterConfig()
    recorder: RecorderConfig = RecorderConfig()
    traffic_out: TrafficOutConfig = TrafficOutConfig()
    leader_out: tuple[LeaderOutConfig, ...] = ()
    guidance: GuidanceConfig = GuidanceConfig()
    parameters: ParametersConfig = ParametersConfig()
    odometry: OdometryConfig = OdometryConfig()
    warm_start: WarmStartConfig = WarmStartConfig()
    ros2: Ros2Config = Ros2Config()

    def table(self) -> dict[str, Any]:
        """Return all values as a TOML table, without those that one section receives from another."""
        table: dict[str, Any] = msgspec.to_builtins(self)
        for name, section in table["estimator"].items():
            table["estimator"][name] = {key: value for key, value in section.items() if key not in DERIVED_KEYS}
        return table

    def camera_model(self) -> Camera:
        """Return the first camera as a geometric model, which holds the others by name."""
        return camera_model(self._cameras())

    def rotors(self) -> tuple[tuple[float, float, int], ...]:
        """Return forward, right and sense of each of our rotors; none if the airframe is unknown."""
        own = self.estimator.get("own_state")
        airframe = None if own is None else own.known_airframe()
        return () if airframe is None else airframe.rotors

    def unnamed_faults(self) -> str:
        """Return the faults that this configuration cannot name, with a remedy, in one line.

        It is "" if all can be named, or if none is estimated.
        """
        if "own_state" not in self.estimator or self.rotors():
            return ""
        return (
            "own_state: airframe unknown, so weak motors, changes of mass and gusts have no name"
            " (`onboard calibrate --mass` finds its constants in a flight)"
        )

    def takes_ranges(self) -> bool:
        """Whether the ranges of detections are used."""
        return any(section.range.detections for section in self.estimator.values() if hasattr(section, "range"))

    def camera_inputs(self) -> dict[str, CameraInput]:
        """Return the decoder's settings for each camera, by name."""
        shapes = [self.estimator.get("leader"), *self.target.values()]
        points = (name for shape in shapes for name in getattr(shape, "points_m", ()))
        sizes = [size for shape in shapes for size in _wingspans(shape)]
        inputs = camera_inputs(self._cameras(), tuple(dict.fromkeys(points)))
        if not sizes:
            return inputs
        return {name: c._replace(sizes=(min(sizes), max(sizes))) for name, c in inputs.items()}

    def camera_delays_ns(self) -> dict[str, int]:
        """Return the delay of each camera that has one of its own, by name."""
        return {c.name: round(c.delay_s * 1e9) for c in self._cameras() if c.delay_s is not None}

    def leader_errors(self) -> dict[str, float]:
        """Return `[ownship.errors]` with the errors of the cameras' mounts, by key.

        The sum of two such errors has the sum of their variances and of their rates of change.
        """
        own, mount = self.ownship.errors, mount_errors(self._cameras())
        tilt = math.hypot(own.tilt_sigma_deg, mount.tilt_sigma_deg)
        yaw = math.hypot(own.yaw_sigma_deg, mount.yaw_sigma_deg)
        anew = own.yaw_sigma_deg**2 / own.attitude_time_s + mount.yaw_sigma_deg**2 / mount.time_s
        time = yaw**2 / anew if anew > 0.0 else own.attitude_time_s
        changed = {"tilt_sigma_deg": tilt, "yaw_sigma_deg": yaw, "attitude_time_s": time}
        return msgspec.to_builtins(own) | changed  # type: ignore[no-any-return]

    def ros_keys(self) -> list[str]:
        """Return the keys of the cameras' topics in ROS, of rmw_zenoh and zenoh-bridge-ros2dds."""
        topics = [topic for c in self._cameras() for topic in (c.ros_topic, c.ros_camera_info) if topic]
        return [key for topic in dict.fromkeys(topics) for key in (f"*/{topic}/*/*", topic)]

    def _cameras(self) -> list[CameraConfig]:
        return name_cameras(self.camera, self.cameras)


def source_delays_ns(delay: DelayConfig, autopilot: int) -> dict[type[Message], int]:
    """Return the delay of each message type, ns.

    Defaults were measured on ArduPilot 4.7: positions are 20 to 25 ms and GPS is 95 ms older than the stamp. Other
    autopilots have 0.
    """
    ardupilot = autopilot == ARDUPILOT

    def ns(configured: float | None, for_ardupilot: float) -> int:
        value = configured if configured is not None else (for_ardupilot if ardupilot else 0.0)
        return round(value * 1e9)

    return {
        LocalPosition: ns(delay.local_position_s, 0.0225),
        GlobalPosition: ns(delay.local_position_s, 0.0225),
        GpsFix: ns(delay.gps_s, 0.095),
        Exposure: ns(delay.camera_s, 0.0),
    }


def _wingspans(shape: Any) -> tuple[float, ...]:
    """Return the smallest and largest wingspan of a section, m; empty without a size."""
    prior = getattr(shape, "size_prior_m", None)
    if prior is None:
        return ()
    sigma = shape.size_prior_sigma_m or 0.0
    return max(prior - 3.0 * sigma, 0.0), prior + 3.0 * sigma
