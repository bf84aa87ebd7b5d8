"""Configuration: TOML -> frozen records. An unknown key is an error that names it and those that are known.

Keys carry their units. `--set KEY=VALUE` puts one value over the file's, with VALUE read as TOML.
"""

import difflib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec

from onboard.errors import UserError
from onboard.estimators import known, load
from onboard.geometry.camera import Camera, make_camera
from onboard.messages import (
    Attitude,
    Barometer,
    GlobalPosition,
    GpsFix,
    Imu,
    LocalPosition,
    Message,
    NotNegative,
    Positive,
    Record,
    TargetPoints,
    Vec3,
)
from onboard.sinks.zenoh_session import ZenohConfig
from onboard.wire.mavlink_encode import message_number

ARDUPILOT: Final = 3
SystemId = Annotated[int, msgspec.Meta(ge=0, le=255)]


class ConfigError(UserError, ValueError):
    """The configuration cannot be used; the message is one line that says where and why."""


class LinkConfig(Record, frozen=True, kw_only=True):
    """`[[link]]`: a name, and udpin:HOST:PORT, udpout:, tcp:, tcpin: or serial:DEVICE:BAUD."""

    name: str
    url: str
    autopilot: bool = True  # heartbeats, TIMESYNC and requests for message rates go out on it


class AutopilotConfig(Record, frozen=True, kw_only=True):
    """`[autopilot]`: whose vehicle this is, and what we ask of it."""

    system: SystemId = 0  # its MAVLink system id; 0: that of the first autopilot heard
    component: SystemId = 191  # our own component id (MAV_COMP_ID_ONBOARD_COMPUTER)
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


class CameraConfig(Record, frozen=True, kw_only=True):
    """`[camera]`: the mount and the lens. Points in pixels bring their own intrinsics with them."""

    name: str = "front"
    f_px: Positive = 554.256
    width_px: Positive = 640.0
    height_px: Positive = 480.0
    sigma_px: Positive = 1.0  # standard deviation of each image coordinate
    mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)  # body to camera, ZYX; [0, 15, 0] looks 15 degrees up
    mount_offset_m: Vec3 = (0.0, 0.0, 0.0)  # camera from the vehicle's position, body FRD


class DelayConfig(Record, frozen=True, kw_only=True):
    """`[delay]`: how much older than its stamp each source is, s. None: what is known of the autopilot."""

    attitude_s: float | None = None
    imu_s: float | None = None
    local_position_s: float | None = None
    global_position_s: float | None = None
    gps_s: float | None = None
    camera_s: float | None = None


class OwnshipConfig(Record, frozen=True, kw_only=True):
    """`[ownship]`"""

    max_extrapolation_s: NotNegative = 0.1  # how far beyond its newest sample our own pose may be carried on
    max_lead_s: NotNegative = 1.0  # images stamped farther ahead of the autopilot's newest stamp are rejected


class OdometryConfig(Record, frozen=True, kw_only=True):
    """`[odometry]`: our own state as MAVLink's ODOMETRY, on one of our links. Never let the autopilot whose
    attitude we use fuse it: that would be its own word come back."""

    link: str | None = None  # its name; None: not sent
    rate_hz: Positive = 30.0


class RecorderConfig(Record, frozen=True, kw_only=True):
    """`[recorder]`: raw bytes as they came, and every estimate, in an MCAP file."""

    path: str | None = None


class TrafficOutConfig(Record, frozen=True, kw_only=True):
    """`[traffic_out]`: tracks of traffic as MAVLink messages on one of the links; without `link` on none."""

    link: str = ""  # its name
    adsb_vehicle: Literal["all", "silent", "none"] = "silent"  # which tracks; silent: those without a transponder
    collision: bool = True  # threats
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0  # of each track


class Config(Record, frozen=True, kw_only=True):
    """Everything the daemon and the replay are told. `estimator` holds each estimator's own Config."""

    link: tuple[LinkConfig, ...] = (
        LinkConfig(name="autopilot", url="udpin:127.0.0.1:14540"),
        LinkConfig(name="camera", url="udpin:127.0.0.1:14560", autopilot=False),
    )
    autopilot: AutopilotConfig = AutopilotConfig()
    camera: CameraConfig = CameraConfig()
    delay: DelayConfig = DelayConfig()
    ownship: OwnshipConfig = OwnshipConfig()
    estimator: dict[str, Any] = msgspec.field(default_factory=dict)
    zenoh: ZenohConfig = ZenohConfig()
    recorder: RecorderConfig = RecorderConfig()
    traffic_out: TrafficOutConfig = TrafficOutConfig()
    odometry: OdometryConfig = OdometryConfig()

    def camera_model(self) -> Camera:
        """The camera as geometry knows it."""
        c = self.camera
        return make_camera(
            name=c.name,
            f_px=c.f_px,
            width_px=c.width_px,
            height_px=c.height_px,
            mount_rpy_deg=c.mount_rpy_deg,
            mount_offset=c.mount_offset_m,
            sigma_px=c.sigma_px,
        )


def source_delays_ns(delay: DelayConfig, autopilot: int) -> dict[type[Message], int]:
    """Delay of each message type, ns. Where not configured: measured on ArduPilot 4.7, whose positions are
    20-25 ms and whose GPS is 95 ms older than its stamp; for other autopilots 0."""
    ardupilot = autopilot == ARDUPILOT

    def ns(configured: float | None, for_ardupilot: float) -> int:
        value = configured if configured is not None else (for_ardupilot if ardupilot else 0.0)
        return round(value * 1e9)

    return {
        Attitude: ns(delay.attitude_s, 0.0),
        Imu: ns(delay.imu_s, 0.0),
        Barometer: ns(delay.imu_s, 0.0),
        LocalPosition: ns(delay.local_position_s, 0.0225),
        GlobalPosition: ns(delay.global_position_s, 0.0225),
        GpsFix: ns(delay.gps_s, 0.095),
        TargetPoints: ns(delay.camera_s, 0.0),
    }


def load_config(path: Path | None, overrides: tuple[str, ...] = ()) -> Config:
    """The configuration of a TOML file (None: the defaults, with the leader estimator) and `--set` overrides.

    Raises ConfigError.
    """
    return parse_config(read_table(path, overrides))


def read_table(path: Path | None, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """What `load_config` makes a configuration of, unchecked. Raises ConfigError for what is not TOML."""
    table: dict[str, Any] = {}
    if path is not None:
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror}") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} is not TOML: {error}") from error
    for override in overrides:
        _put(table, override)
    table.setdefault("estimator", {"leader": {}})
    return table


def named_estimators(table: dict[str, Any]) -> dict[str, Any]:
    """The sections of a table's estimators by their names, unchecked, without loading any. Raises ConfigError."""
    sections = table.get("estimator", {})
    if not isinstance(sections, dict):
        raise ConfigError("`estimator` must be a table of tables, such as [estimator.leader]")
    for name in sections:
        if name not in known():
            raise ConfigError(f"unknown key estimator.{name}{_among(name, known())}")
    return sections


def parse_config(table: dict[str, Any]) -> Config:
    """The configuration of a table as TOML gives it. Raises ConfigError."""
    config: Config = _convert({k: v for k, v in table.items() if k != "estimator"}, Config, "")
    for name, rate in config.autopilot.rates_hz.items():
        if not _is_message(name):
            raise ConfigError(f"autopilot.rates_hz.{name}: there is no MAVLink message of this name")
        if not rate > 0:
            raise ConfigError(f"autopilot.rates_hz.{name}: must be positive, not {rate}")
    named = tuple(link.name for link in config.link)
    if config.traffic_out.link and config.traffic_out.link not in named:
        raise ConfigError(f"traffic_out.link: no link is called {config.traffic_out.link!r}{_among('', named)}")
    if config.odometry.link and config.odometry.link not in named:
        raise ConfigError(f"odometry.link: no link is called {config.odometry.link!r}{_among('', named)}")
    sections = {}
    for name, section in named_estimators(table).items():
        module = load(name)
        sections[name] = _convert(section, module.Config, f"estimator.{name}")
        try:
            module.Estimator(sections[name], config.camera_model())
        except ValueError as error:
            raise ConfigError(f"estimator.{name}: {error}") from error
    return msgspec.structs.replace(config, estimator=sections)


def _is_message(name: str) -> bool:
    try:
        message_number(name)
    except KeyError:
        return False
    return True


def _put(table: dict[str, Any], override: str) -> None:
    """Put KEY=VALUE into a nested table."""
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {override!r}: must be KEY=VALUE, such as camera.f_px=554.3")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a bare word is a string
    *path, last = key.strip().split(".")
    for part in path:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {override!r}: `{part}` holds a value, not a table")
    table[last] = value


def _convert(table: Any, kind: type[Any], at: str) -> Any:
    """A table as a record, strictly; errors name the key by its full path."""
    if not isinstance(table, dict):
        raise ConfigError(f"`{at}` must be a table, not {table!r}")
    _check_keys(table, kind, at)
    _check_finite(table, at)
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        text, _, path = str(error).partition(" - at `$")
        where = f"{at}{path.rstrip('`')}".lstrip(".") or at
        raise ConfigError(f"{where}: {text[0].lower()}{text[1:]}") from error


def _check_keys(table: dict[str, Any], kind: Any, at: str) -> None:
    """Raise for a key that `kind` does not have, here or in the tables below."""
    fields = {field.name: field.type for field in msgspec.structs.fields(kind)}
    for key, value in table.items():
        path = f"{at}.{key}".lstrip(".")
        if key not in fields:
            raise ConfigError(f"unknown key {path}{_among(key, tuple(fields))}")
        if isinstance(value, dict) and isinstance(fields[key], type) and issubclass(fields[key], Record):
            _check_keys(value, fields[key], path)
        if isinstance(value, list) and fields[key] == tuple[LinkConfig, ...]:
            for i, item in enumerate(value):
                if isinstance(item, dict):
                    _check_keys(item, LinkConfig, f"{path}[{i}]")


def _check_finite(value: Any, at: str) -> None:
    """Raise for a number, however deep, that is not finite: TOML has nan and inf, we have no use for them."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{at}: must be a finite number, not {value}")
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inside:
        _check_finite(item, f"{at}[{key}]" if isinstance(value, list) else f"{at}.{key}".lstrip("."))


def _among(key: str, names: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(key, names, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    return f"{hint}; known: {', '.join(names)}"
