"""The configuration that a daemon needs for a scenario: what its user knows. That is the camera, the leader's
wingspan and class, our own craft, and where its autopilot is to follow. Nobody tells a daemon how large errors
are: they stay at its defaults."""

from typing import Final

from simlink.scenarios.camera import Camera, Sees
from simlink.scenarios.formation import NAMED_POINTS
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.traffic import FIRST_ICAO, FIRST_SYSTEM, LEADER

AIRCRAFT: Final[dict[Sees, str]] = {"box": "fixed-wing", "center_box": "fixed-wing", "rotor_box": "quadrotor"}


def daemon_config(scenario: Scenario) -> str:
    """Configuration of `onboard` in TOML. The prior of the leader's size is the nominal size."""
    camera, leader = scenario.camera, scenario.leader
    lines = [
        f"# Made by `simlink config {scenario.name}`.",
        "",
        "[camera]",
        f'name = "{camera.name}"',
        f"f_px = {camera.f_px}",
        f"width_px = {camera.width_px}",
        f"height_px = {camera.height_px}",
        *_lens(camera),
        f"mount_rpy_deg = {list(camera.mount_rpy_deg)}",
        f"mount_offset_m = {list(camera.mount_offset)}",
    ]
    if camera.gimbal is not None:
        lines.append(f"gimbal = {camera.gimbal.component}")
    kind = "multirotor" if scenario.follower.attitude == "hover" else "fixed_wing"
    lines += ["", "[estimator.leader]", f"size_prior_m = {leader.size}", f'leader_class = "{kind}"']
    lines.append("center_on_wing = true")
    if camera.sees in AIRCRAFT:
        lines.append(f'aircraft = "{AIRCRAFT[camera.sees]}"')
    if camera.sees == "points":
        at = (f"{name} = {[leader.size * x for x in point]}" for name, point in NAMED_POINTS.items())
        lines += [f"points_m = {{ {', '.join(at)} }}", "named_wingtips = true"]
    lines += _beside(scenario)
    if scenario.quadrotor is not None:
        lines += _own_state(scenario.quadrotor, scenario)
    if scenario.traffic.aircraft:
        lines += ["", "[estimator.traffic]"]
    if scenario.follow is not None:
        lines += ["", "[guidance]", f"slot_m = {list(scenario.follow.offset)}"]
        lines += ["", "[[leader_out]]", 'link = "autopilot"']
        lines.append("rates_hz = { SET_POSITION_TARGET_LOCAL_NED = 25.0 }")
    return "\n".join(lines)


def _beside(scenario: Scenario) -> list[str]:
    """Whose broadcasts and ranges are the leader's."""
    lines: list[str] = []
    if scenario.broadcast is not None and scenario.broadcast.says == "adsb":
        lines += ["", "[estimator.leader.broadcast]", f'icao = "{FIRST_ICAO + LEADER:06x}"', "trusted = true"]
    elif scenario.broadcast is not None:
        lines += ["", "[estimator.leader.broadcast]", f"system = {FIRST_SYSTEM + LEADER}", "trusted = true"]
    if scenario.rangefinder is not None:
        lines += ["", "[estimator.leader.range]", f"sensor = {scenario.rangefinder.sensor}"]
    return lines


def _lens(camera: Camera) -> list[str]:
    """What a calibration says of a lens that distorts."""
    if not camera.distortion:
        return []
    return [f'distortion_model = "{camera.distortion_model}"', f"distortion = {list(camera.distortion)}"]


def _own_state(craft: Quadrotor, scenario: Scenario) -> list[str]:
    """The section of the own-state estimator: the nominal craft, and how late its fixes are."""
    lines = ["", "[delay]", f"gps_s = {scenario.gps.delay}", "", "[estimator.own_state]"]
    if _constants(craft) == _constants(Quadrotor()):
        return [*lines, 'airframe = "csvsf"']
    rotors = ", ".join(f"[{x}, {y}, {sense:.0f}]" for x, y, sense in craft.rotors)
    return [
        *lines,
        'airframe = "custom"',
        "",
        "[estimator.own_state.custom]",
        f"mass_kg = {craft.mass}",
        f"inertia_kg_m2 = {list(craft.inertia)}",
        f"rotors = [{rotors}]",
        f"thrust_max_n = {craft.thrust_max}",
        f"torque_per_thrust_m = {craft.torque_per_thrust}",
        f"drag_per_s = {craft.drag}",
    ]


def _constants(craft: Quadrotor) -> tuple[object, ...]:
    """What an airframe of `onboard` holds. Those of simlink's default craft have a name there."""
    body = (craft.mass, craft.inertia, craft.rotors, craft.thrust_max, craft.torque_per_thrust, craft.drag)
    return *body, craft.battery.full
