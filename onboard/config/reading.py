"""Reading of the configuration from TOML.

An unknown key is an error that names it and the known ones. `--set KEY=VALUE` overrides one value of the file;
VALUE is read as TOML.
"""

import difflib
import math
import os
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin
from urllib.parse import unquote

import msgspec

from onboard import UserError
from onboard.config.bounds import not_tunable, out_of_range
from onboard.config.cameras import CameraConfig
from onboard.config.recorded import read_recorded
from onboard.config.sections import DERIVED_KEYS, AutopilotConfig, Config, LeaderOutConfig, LinkConfig
from onboard.estimators import config_type, known
from onboard.messages import Record, TargetClass
from onboard.wire.documents.document import NAME
from onboard.wire.mavlink.encode import message_number

ROW_TYPES: Final[dict[Any, type[Record]]] = {  # arrays of tables
    tuple[LinkConfig, ...]: LinkConfig,
    tuple[LeaderOutConfig, ...]: LeaderOutConfig,
}
NAMED_TYPES: Final[dict[Any, type[Record]]] = {  # tables of tables, by name
    dict[str, CameraConfig]: CameraConfig,
    dict[str, TargetClass]: TargetClass,
}


PATH_KEYS: Final = ("path", "calibration")
CALIBRATION_KEYS: Final = ("f_px", "fy_px", "cx_px", "cy_px", "distortion_model", "distortion")
FILE_ADDRESS: Final = "file:///"
BARE_NUMBER: Final = re.compile(r"[+-]?(\.\d+|\d+\.)")  # accepted from users, but not by TOML
AUTOPILOT_COMPONENT_ID: Final = 1  # MAV_COMP_ID_AUTOPILOT1
GIMBAL_MESSAGE: Final = "GIMBAL_DEVICE_ATTITUDE_STATUS"
REQUESTED_GIMBAL_RATE_HZ: Final = 25.0
OUT_OF_RANGE: Final = re.compile(r"expected `\w+` [<>]")  # of msgspec
INVALID_CHOICE: Final = re.compile("invalid enum value ")  # of msgspec
STEP_OF_PATH: Final = re.compile(r"\.(\w+)|\[(\d+)\]")
CAMERA_ESTIMATOR: Final = "leader"  # the estimator that uses the cameras


class ConfigError(UserError, ValueError):
    """An unusable configuration; the message is one line with place and reason."""


def load_config(path: Path | None, overrides: tuple[str, ...] = ()) -> Config:
    """Return the configuration of a TOML file or a recorded flight, with `--set` overrides.

    Without a path it is the defaults with the leader estimator. Raises ConfigError.
    """
    table = _expand_paths(read_table(path, overrides))
    try:
        return parse_config(table)
    except ConfigError as error:
        if overrides:
            load_config(path)  # reports an error of the file itself
        elif path is not None and read_recorded(path):
            raise ConfigError(
                f"the configuration recorded in {path} is invalid: {error}; choose another with --config"
            ) from error
        raise


def read_table(path: Path | None, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the unchecked table of a file and overrides.

    Raises ConfigError for a file that is not TOML.
    """
    table: dict[str, Any] = {}
    if path is not None:
        table = read_recorded(path) or read_toml(path)
    table = _expand_paths(table)
    stored = table.get("parameters", {})
    stored_path = stored.get("path") if isinstance(stored, dict) else None
    if isinstance(stored_path, str) and Path(stored_path).exists():
        kept = read_toml(Path(stored_path))
        for key in not_tunable(kept):
            raise ConfigError(f"{stored_path}: {key} is not a parameter; move it to the configuration file")
        table = _merge(table, kept)
    for override in overrides:
        _apply_override(table, override)
    table.setdefault("estimator", {"leader": {}})
    return table


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file. Raises ConfigError."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))  # Windows editors write a byte order mark
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except RecursionError as error:
        raise ConfigError(f"{path} is nested too deeply; use fewer levels of tables and arrays") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from error


def _expand_paths(value: Any, key: str = "") -> Any:
    """Return a table with variables and ROS addresses in its file names resolved.

    `~`, `$HOME` and other variables are expanded.
    """
    if isinstance(value, dict):
        return {name: _expand_paths(inner, name) for name, inner in value.items()}
    if isinstance(value, list):
        return [_expand_paths(inner, key) for inner in value]
    is_path = isinstance(value, str) and (key in PATH_KEYS or key.endswith("_file"))
    if is_path and value.startswith(FILE_ADDRESS):
        return unquote(value.removeprefix(FILE_ADDRESS[:-1]))
    return _expand_path(key, value) if is_path and value.startswith(("~", "$")) else value


def _expand_path(key: str, value: str) -> str:
    """Expand home or variable at the start of a file name.

    Raises ConfigError if it is unknown: unexpanded, it would create a folder named `~` in the working directory.
    """
    try:
        found = os.path.expandvars(Path(value).expanduser())
    except RuntimeError as error:
        raise ConfigError(f"{key}: {value}: the home folder is unknown; write the full path") from error
    if found.startswith("$"):
        raise ConfigError(f"{key}: {value}: this variable is not set; write the full path")
    return found


def _merge(table: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return a table overridden by another's values, table by table."""
    inner = {k for k in over if isinstance(over[k], dict) and isinstance(table.get(k), dict)}
    return {**table, **over, **{k: _merge(table[k], over[k]) for k in inner}}


def named_estimators(table: dict[str, Any]) -> dict[str, Any]:
    """Return the unchecked sections of a table's estimators by name, without loading any.

    Raises ConfigError.
    """
    sections = table.get("estimator", {})
    if not isinstance(sections, dict):
        raise ConfigError("`estimator` must be a table of tables, such as [estimator.leader]")
    for name in sections:
        if name not in known():
            raise ConfigError(f"unknown key estimator.{name}{_suggestion(name, known())}")
    return sections


def parse_config(table: dict[str, Any]) -> Config:
    """Return the configuration of a table as TOML gives it. Raises ConfigError."""
    config: Config = _convert({k: v for k, v in table.items() if k != "estimator"}, Config, "")
    _check_cameras(config)
    _check_lenses(table)
    _check_own_reports(config)
    config = _with_rates(config)
    named = tuple(link.name for link in config.link)
    wanted = {"traffic_out.link": config.traffic_out.link, "odometry.link": config.odometry.link}
    wanted |= {f"leader_out[{i}].link": out.link for i, out in enumerate(config.leader_out)}
    for key, link in wanted.items():
        if link and link not in named:
            raise ConfigError(f"{key}: no link has the name {link!r}{_suggestion('', named)}")
    if config.autopilot.component == AUTOPILOT_COMPONENT_ID:
        raise ConfigError(
            f"autopilot.component is {AUTOPILOT_COMPONENT_ID}, that of the autopilot itself; "
            "use another, such as 191 (an onboard computer)"
        )
    for i, out in enumerate(config.leader_out):
        if config.autopilot.system == out.system:
            raise ConfigError(f"leader_out[{i}].system is {out.system}, that of our own autopilot; use another")
    sections = {}
    for name, section in named_estimators(table).items():
        kind = config_type(name)
        own = msgspec.to_builtins(config.ownship.errors)
        errors = config.leader_errors() if name == CAMERA_ESTIMATOR else own
        sections[name] = _convert(_with_derived(section, config, errors, kind, name), kind, f"estimator.{name}")
    _check_broadcast(config, sections.get(CAMERA_ESTIMATOR))
    whole = msgspec.structs.replace(config, estimator=sections)
    for reason in out_of_range(whole):
        raise ConfigError(reason)
    return whole


def _check_broadcast(config: Config, leader: Any) -> None:
    """Raise ConfigError for a leader's broadcast with our own id."""
    system = leader.broadcast.system if leader is not None else 0
    key = f"estimator.{CAMERA_ESTIMATOR}.broadcast.system"
    if system and any(out.system == system for out in config.leader_out):
        raise ConfigError(f"{key} is {system}, but [[leader_out]] sends as this system; use the leader's own")
    if system and config.autopilot.system == system:
        raise ConfigError(f"{key} is {system}, that of our own vehicle; use the leader's own system")


def _check_cameras(config: Config) -> None:
    """Raise ConfigError for a camera name that is used twice or cannot be part of a key."""
    for name, camera in config.cameras.items():
        if name == config.camera.name:
            raise ConfigError(f"cameras.{name}: [camera] already has this name; choose another")
        if camera.name not in (CameraConfig().name, name):
            raise ConfigError(f"cameras.{name}.name: remove it, since the section gives the name")
        if not NAME.fullmatch(name):
            raise ConfigError(f"cameras.{name}: use at most 64 letters, digits and -_. for a name")


def _check_lenses(table: dict[str, Any]) -> None:
    """Raise ConfigError for a camera key that `calibration` overrides."""
    sections = {"camera": table.get("camera", {})}
    sections |= {f"cameras.{name}": section for name, section in table.get("cameras", {}).items()}
    for at, section in sections.items():
        without = [key for key in CALIBRATION_KEYS if key in section]
        if section.get("calibration") is not None and without:
            raise ConfigError(f"{at}.{without[0]}: the file of {at}.calibration also has it; remove one of them")


def _with_derived(section: Any, config: Config, errors: dict[str, float], kind: type[Record], name: str) -> Any:
    """Return an estimator's section with its keys from `[target]` and `[ownship.errors]`.

    Raises ConfigError for a section that sets such a key to another value; recordings hold the same one.
    """
    values: dict[str, Any] = {f"own_{key}": value for key, value in errors.items()}
    values["target"] = msgspec.to_builtins(config.target)
    derived = {field.name: values[field.name] for field in _fields(kind) if field.name in DERIVED_KEYS}
    for key in derived if isinstance(section, dict) else ():
        if not _is_same(section.get(key, derived[key]), derived[key]):
            source = f"ownship.errors.{key.removeprefix('own_')}" if key.startswith("own_") else f"[{key}.CLASS]"
            raise ConfigError(f"unknown key estimator.{name}.{key}: it was withdrawn; set {source}")
    return section | derived if isinstance(section, dict) else section


def _check_own_reports(config: Config) -> None:
    """Raise ConfigError if the leader messages that we send would return to us as its images."""
    sent = {out.camera_component for out in config.leader_out if "CAMERA_TRACKING_IMAGE_STATUS" in out.rates_hz}
    for camera in (config.camera, *config.cameras.values()):
        if camera.tracker in sent:
            raise ConfigError(
                f"camera {camera.name}: tracker is {camera.tracker}, but [[leader_out]] sends as this component; "
                "use another"
            )
        if camera.landing_target == "aircraft" and any("LANDING_TARGET" in o.rates_hz for o in config.leader_out):
            raise ConfigError(
                f"camera {camera.name}: landing_target: [[leader_out]] sends LANDING_TARGET too; remove one"
            )


def _with_rates(config: Config) -> Config:
    """Return the configuration with the default rates of requested messages.

    It requests the gimbal's attitude if a camera is on one, and drops rates of 0. Raises ConfigError.
    """
    for name, rate in config.autopilot.rates_hz.items():
        if not _is_message(name):
            raise ConfigError(f"autopilot.rates_hz.{name}: no MAVLink message has this name")
        if not rate >= 0:
            raise ConfigError(f"autopilot.rates_hz.{name} is {rate}; use a positive rate, or 0 for no request")
    cameras = (config.camera, *config.cameras.values())
    gimbal = {} if all(camera.gimbal is None for camera in cameras) else {GIMBAL_MESSAGE: REQUESTED_GIMBAL_RATE_HZ}
    rates = {**AutopilotConfig().rates_hz, **gimbal, **config.autopilot.rates_hz}
    asked = {name: rate for name, rate in rates.items() if rate > 0.0}
    return msgspec.structs.replace(config, autopilot=msgspec.structs.replace(config.autopilot, rates_hz=asked))


def _is_message(name: str) -> bool:
    try:
        message_number(name)
    except KeyError:
        return False
    return True


def _apply_override(table: dict[str, Any], override: str) -> None:
    """Put KEY=VALUE into a nested table."""
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {override!r}: must be KEY=VALUE, such as camera.f_px=554.3")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = float(text) if BARE_NUMBER.fullmatch(text.strip()) else text.strip()  # a bare word is a string
    *path, last = key.strip().split(".")
    if not isinstance(value, str) and _is_text((*path, last)):
        value = text.strip()  # 7 may be a name
    for part in path:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {override!r}: `{part}` holds a value, not a table")
    table[last] = value


def _is_text(path: tuple[str, ...]) -> bool:
    """Whether the key of this path takes text only."""
    kind: Any = Config
    if path[0] == "estimator" and len(path) > 1 and path[1] in known():
        kind, path = config_type(path[1]), path[2:]
    for key in path:
        if kind in NAMED_TYPES:
            kind = NAMED_TYPES[kind]
            continue
        fields = _fields(kind) if isinstance(kind, type) and issubclass(kind, Record) else ()
        kind = next((field.type for field in fields if field.name == key), None)
    return kind in (str, str | None)


def _convert(table: Any, kind: type[Any], at: str) -> Any:
    """Convert a table to a record, strictly; errors name the key by its full path."""
    if not isinstance(table, dict):
        raise ConfigError(f"`{at}` must be a table, not {table!r}")
    table = _checked(table, kind, at)
    _check_finite(table, at)
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        text, _, path = str(error).partition(" - at `$")
        where = f"{at}{path.rstrip('`')}".lstrip(".") or at
        reason = f"{text[0].lower()}{text[1:]}"
        is_of_key = path and "[...]" not in path  # not of a key or value of a dict
        if is_of_key and (OUT_OF_RANGE.match(reason) or INVALID_CHOICE.match(reason)):
            keys = [key or int(index) for key, index in STEP_OF_PATH.findall(path)]
            raise ConfigError(
                f"{where} is {_value_at(table, keys)!r}: {_expectation(reason, kind, keys)}"
            ) from error
        raise ConfigError(reason if reason.startswith(where) else f"{where}: {reason}") from error


def _is_same(value: Any, known: Any) -> bool:
    """Whether a value of TOML or JSON, which have lists for tuples, is a known one."""
    return bool(value == known) or msgspec.json.encode(value) == msgspec.json.encode(known)


def _value_at(value: Any, keys: list[str | int]) -> Any:
    """Return the value of a table at a path."""
    for key in keys:
        value = value[key]
    return value


def _expectation(reason: str, kind: Any, keys: list[str | int]) -> str:
    """Return msgspec's reason; for an invalid choice, return the valid ones."""
    if OUT_OF_RANGE.match(reason):
        return reason
    for key in keys:
        if isinstance(key, str):
            kind = next(field.type for field in _fields(ROW_TYPES.get(kind, kind)) if field.name == key)
    choices = [repr(choice) for choice in _choices(kind)]
    return f"expected one of {', '.join(choices)}" if len(choices) > 1 else f"expected {choices[0]}"


def _choices(kind: Any) -> list[Any]:
    """Return the values of the literals in a type."""
    inside = get_args(kind)
    return (
        list(inside) if get_origin(kind) is Literal else [choice for part in inside for choice in _choices(part)]
    )


def _checked(table: dict[str, Any], kind: Any, at: str) -> dict[str, Any]:
    """Return a table without withdrawn keys that have the value of their constant, as in older recordings.

    Raises ConfigError for a key that `kind` does not have, here or in nested tables.
    """
    fields = {field.name: field.type for field in _fields(kind)}
    checked = {}
    for key, value in table.items():
        path = f"{at}.{key}".lstrip(".")
        if key not in fields and key in _constants(kind):
            constant = getattr(kind, key)
            if not _is_same(value, constant):
                raise ConfigError(f"unknown key {path}: it was withdrawn, and is always {constant}")
            continue
        if key not in fields:
            raise ConfigError(f"unknown key {path}{_suggestion(key, tuple(fields))}")
        checked[key] = value
        if isinstance(value, dict) and isinstance(fields[key], type) and issubclass(fields[key], Record):
            checked[key] = _checked(value, fields[key], path)
        if isinstance(value, dict) and fields[key] in NAMED_TYPES:  # errors of `_convert` name the whole path
            kinds = NAMED_TYPES[fields[key]]
            checked[key] = {name: _convert(item, kinds, f"{path}.{name}") for name, item in value.items()}
        rows = ROW_TYPES.get(fields[key])
        if isinstance(value, list) and rows is not None:
            checked[key] = [
                _checked(item, rows, f"{path}[{i}]") if isinstance(item, dict) else item
                for i, item in enumerate(value)
            ]
    return checked


@cache
def _constants(kind: type[Record]) -> frozenset[str]:
    """Return the names of a section's constants, which were keys once."""
    return frozenset().union(*(each.__annotations__ for each in kind.__mro__ if "__annotations__" in vars(each)))


@cache  # reading annotations takes most of the time of a check
def _fields(kind: type[Record]) -> tuple[Any, ...]:
    return msgspec.structs.fields(kind)


def _check_finite(value: Any, at: str) -> None:
    """Raise ConfigError for a number at any depth that is not finite: TOML allows nan and inf."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{at}: must be a finite number, not {value}")
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inside:
        _check_finite(item, f"{at}[{key}]" if isinstance(value, list) else f"{at}.{key}".lstrip("."))


def _suggestion(key: str, names: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(key, names, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    return f"{hint}; known: {', '.join(names)}"
