"""Scenarios: TOML files read into frozen records, in SI units.

The defaults are the reference formation flight of Oh & Johnson (relative motion by vision), in metres instead of
feet: a leader at 70 ft/s in a steady right turn of 8 ft/s^2, the follower 90 ft behind, 10 ft to the right and 5
ft below. `scenarios/formation.toml` lists every default; the other files contain only the differences.
"""

import math
import re
import tomllib
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import msgspec

from onboard.geometry.lens import LensError
from onboard.messages import Positive, Record
from simlink.scenarios.camera import BOXES, Camera, lens_of
from simlink.scenarios.formation import Follow, Follower, Leader
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.rangefinder import Rangefinder
from simlink.scenarios.traffic import MAX_AIRCRAFT_COUNT, Broadcast, TrafficScene
from simlink.scenarios.vehicle import BarometerErrors, Gps, ImuErrors, Nav, Outliers, Vehicle

SCENARIO_FOLDER = Path(__file__).parent


class ScenarioError(ValueError):
    """An unknown or invalid scenario; the message is one line with the file and the key."""


class Scenario(Record, frozen=True, kw_only=True):
    """One flight; pulses and blackouts repeat every `repeat` seconds, `duration` is in s.

    Two fields apply to runs on the wire and through a pipeline only (`simlink.world.drawn`). With `own_errors` the
    seed draws the sizes of the autopilot's attitude and velocity errors. `spread` is the largest factor by which
    the sizes of errors, their correlation times and latencies differ from run to run.
    """

    name: str = "formation"
    description: str = ""
    duration: Positive = 60.0
    repeat: Positive = 60.0
    own_errors: bool = False
    spread: Annotated[float, msgspec.Meta(ge=1, le=4)] = 1.0
    leader: Leader = Leader()
    follower: Follower = Follower()
    camera: Camera = Camera()
    nav: Nav = Nav()
    imu: ImuErrors = ImuErrors()
    barometer: BarometerErrors = BarometerErrors()
    gps: Gps = Gps()
    vehicle: Vehicle = Vehicle()
    outliers: Outliers = Outliers()
    quadrotor: Quadrotor | None = None
    follow: Follow | None = None
    traffic: TrafficScene = TrafficScene()
    broadcast: Broadcast | None = None  # None: the leader sends none
    rangefinder: Rangefinder | None = None


def scenario_names() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    return tuple(sorted(path.stem for path in SCENARIO_FOLDER.glob("*.toml")))


def load_scenario(name_or_path: str) -> Scenario:
    """Return the scenario of this name, or of this .toml file.

    Raises ScenarioError if it does not exist or is not valid.
    """
    if name_or_path.endswith(".toml"):
        path = Path(name_or_path)
    elif name_or_path in scenario_names():
        path = SCENARIO_FOLDER / f"{name_or_path}.toml"
    else:
        known = ", ".join(scenario_names())
        raise ScenarioError(f"no scenario {name_or_path!r}; known: {known}, or the path of a .toml file")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ScenarioError(f"{path}: {reason}") from error
    return parse_scenario(text, path.stem, str(path))


def parse_scenario(text: str, name: str, source: str = "scenario") -> Scenario:
    """Parse a scenario from TOML; a ScenarioError begins with `source` and names the key."""
    data = _tables(text, source)
    data.setdefault("name", name)
    for path, value in _numbers(data, ""):
        if not math.isfinite(value):
            raise ScenarioError(f"{source}: {path} must be finite, not {value}")
    try:
        scenario = msgspec.convert(data, Scenario)
    except msgspec.ValidationError as error:
        raise ScenarioError(f"{source}: {_explain(str(error))}") from error
    check(scenario, source)
    return scenario


def _tables(text: str, source: str) -> dict[str, Any]:
    """Merge a TOML text into the scenario that it `extends`. Raises ScenarioError."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{source}: {error}") from error
    base = data.pop("extends", None)
    if base is None:
        return data
    if base not in scenario_names():
        raise ScenarioError(f"{source}: extends: no scenario {base!r}; known: {', '.join(scenario_names())}")
    return _merged(_tables((SCENARIO_FOLDER / f"{base}.toml").read_text(encoding="utf-8"), base), data)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes`: tables are merged, everything else is replaced."""
    tables = [key for key in changes if isinstance(changes[key], dict) and isinstance(base.get(key), dict)]
    return base | changes | {key: _merged(base[key], changes[key]) for key in tables}


def rotate_slot(scenario: Scenario, angle_deg: float) -> Scenario:
    """Rotate the slot about the leader by `angle_deg`, and the camera back.

    The leader is then yawed by that angle against the image plane; in a turn, by the angle less the difference of
    the two courses.
    """
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    x, y, z = scenario.follower.slot
    roll, pitch, yaw = scenario.camera.mount_rpy_deg
    follower = msgspec.structs.replace(scenario.follower, slot=(c * x - s * y, s * x + c * y, z))
    camera = msgspec.structs.replace(scenario.camera, mount_rpy_deg=(roll, pitch, yaw + angle_deg))
    return msgspec.structs.replace(scenario, follower=follower, camera=camera)


def check(s: Scenario, source: str) -> None:
    """Check conditions on several fields. Raises ScenarioError with `source`."""
    for key, intervals in (
        ("leader.speed_pulses", s.leader.speed_pulses),
        ("leader.climb_pulses", s.leader.climb_pulses),
        ("leader.yaw_pulses_deg", s.leader.yaw_pulses_deg),
        ("follower.slot_pulses", s.follower.slot_pulses),
        ("camera.blackouts", s.camera.blackouts),
        ("camera.mistaken", s.camera.mistaken),
        ("gps.outages", s.gps.outages),
        ("traffic.radar.jammed", s.traffic.radar.jammed),
        ("traffic.radar.lost", s.traffic.radar.lost),
        ("traffic.receiver.masked", s.traffic.receiver.masked),
        ("traffic.receiver.lost", s.traffic.receiver.lost),
    ):
        for interval in intervals:
            if not interval.start < interval.end <= s.repeat:
                raise ScenarioError(f"{source}: {key}: needs start < end <= repeat ({s.repeat:g} s)")
    for key, pulses in (
        ("leader.speed_pulses", s.leader.speed_pulses),
        ("leader.climb_pulses", s.leader.climb_pulses),
        ("leader.yaw_pulses_deg", s.leader.yaw_pulses_deg),
        ("follower.slot_pulses", s.follower.slot_pulses),
    ):
        if any(pulse.hold >= pulse.end - pulse.start for pulse in pulses):
            raise ScenarioError(f"{source}: {key}: hold must be shorter than end - start")
    # a point mass needs speed to turn; in straight flight it may stop, and ahead of a multirotor fly backwards
    turns = any((w.mean, w.amplitude) != (0.0, 0.0) for w in (s.leader.a_lat, s.leader.a_long))
    turns = turns or bool(s.leader.a_lat_pulses)
    slowest = s.leader.speed + sum(min(p.change, 0.0) for p in s.leader.speed_pulses)
    hovers = s.follower.attitude == "hover"
    if slowest < (1.0 if turns else -math.inf if hovers else 0.0):
        least = "at least 1 m/s in a turn" if turns else "0 m/s or more, unless the follower hovers"
        raise ScenarioError(f"{source}: leader.speed_pulses: the speed falls to {slowest:g} m/s; keep {least}")
    if slowest < 1.0 and not hovers and s.quadrotor is None:
        raise ScenarioError(f'{source}: follower.attitude must be "hover" behind a leader that stops')
    names = [aircraft.name for aircraft in s.traffic.aircraft]
    if len(set(names)) < len(names) or len(names) > MAX_AIRCRAFT_COUNT:
        raise ScenarioError(
            f"{source}: traffic.aircraft: at most {MAX_AIRCRAFT_COUNT}, each with a name of its own"
        )
    _check_camera(s.camera, source)


def _check_camera(camera: Camera, source: str) -> None:
    if camera.stamp_late > camera.latency:
        late, latency = camera.stamp_late, camera.latency
        raise ScenarioError(f"{source}: camera.stamp_late is {late:g} s; at most camera.latency ({latency:g} s)")
    if camera.wrong_blob and camera.sees != "wing":
        raise ScenarioError(f"{source}: camera.wrong_blob needs camera.sees = 'wing', not {camera.sees!r}")
    try:
        lens_of(camera)
    except LensError as error:
        raise ScenarioError(f"{source}: camera.distortion: {error}") from error
    if camera.least_inside < 1.0 and camera.sees not in BOXES:
        raise ScenarioError(
            f"{source}: camera.least_inside below 1 needs camera.sees 'box' or 'rotor_box', not {camera.sees!r}"
        )
    if camera.distortion and camera.pictures != "none":
        raise ScenarioError(f"{source}: camera.distortion: pictures need a lens without distortion; remove it")
    if camera.blob_span_px[0] > camera.blob_span_px[1]:
        raise ScenarioError(f"{source}: camera.blob_span_px: put the smaller number first")


def _numbers(value: Any, path: str) -> Iterator[tuple[str, float]]:
    """Yield every float in nested tables and lists, with its dotted key."""
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _numbers(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _numbers(inner, f"{path}[{i}]")


def _explain(error: str) -> str:
    """Return msgspec's message; for an unknown key, one with the known keys of that table."""
    unknown = re.fullmatch(r"Object contains unknown field `(.+?)`(?: - at `\$\.?(.*)`)?", error)
    if unknown is None:
        return error.replace("`$.", "`")
    key, path = unknown[1], unknown[2] or ""
    table: Any = Scenario
    for part in re.findall(r"[^.\[\]]+", re.sub(r"\[[^\]]*\]", "", path)):
        table = typing.get_type_hints(table)[part]
        if isinstance(table, types.GenericAlias | types.UnionType):  # tuple[Pulse, ...], Quadrotor | None
            table = typing.get_args(table)[0]
    known = ", ".join(field.name for field in msgspec.structs.fields(table))
    where = f"[{path}]" if path else "the top level"
    return f"unknown key {key!r} in {where}; known: {known}"
