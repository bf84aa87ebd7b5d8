"""The daemon's configuration for a scenario: only what its user would know.

That is the camera, the leader's wingspan and class, our own craft, and the slot to follow in. The sizes of errors
stay at the daemon's defaults.
"""

from typing import Final

from simlink.scenarios.camera import Camera, Sees
from simlink.scenarios.formation import NAMED_POINTS
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.traffic import FIRST_ICAO, FIRST_SYSTEM_ID, LEADER_INDEX

AIRCRAFT: Final[dict[Sees, str]] = {"box": "fixed-wing", "center_box": "fixed-wing", "rotor_box": "quadrotor"}


def daemon_config(scenario: Scenario) -> str:
    """Return `onboard`'s configuration in TOML, with the leader's nominal size as prior."""
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
    lines += _leader_sources(scenario)
    if scenario.quadrotor is not None:
        lines += _own_state(scenario.quadrotor, scenario)
    if scenario.traffic.aircraft:
        lines += ["", "[estimator.traffic]"]
    if scenario.follow is not None:
        lines += ["", "[guidance]", f"slot_m = {list(scenario.follow.offset)}"]
        lines += ["", "[[leader_out]]", 'link = "autopilot"']
        lines.append("rates_hz = { SET_POSITION_TARGET_LOCAL_NED = 25.0 }")
    return "\n".join(lines)


def _leader_sources(scenario: Scenario) -> list[str]:
    """Return the sections that name the leader's own broadcast and the rangefinder."""
    lines: list[str] = []
    if scenario.broadcast is not None and scenario.broadcast.says == "adsb":
        lines += [
            "",
            "[estimator.leader.broadcast]",
            f'icao = "{FIRST_ICAO + LEADER_INDEX:06x}"',
            "trusted = true",
        ]
    elif scenario.broadcast is not None:
        lines += [
            "",
            "[estimator.leader.broadcast]",
            f"system = {FIRST_SYSTEM_ID + LEADER_INDEX}",
            "trusted = true",
        ]
    if scenario.rangefinder is not None:
        lines += ["", "[estimator.leader.range]", f"sensor = {scenario.rangefinder.sensor}"]
    return lines


def _lens(camera: Camera) -> list[str]:
    """Return the lines of the calibration of a lens that distorts."""
    if not camera.distortion:
        return []
    return [f'distortion_model = "{camera.distortion_model}"', f"distortion = {list(camera.distortion)}"]


def _own_state(craft: Quadrotor, scenario: Scenario) -> list[str]:
    """Return the section of the own-state estimator: the nominal craft and the GPS delay."""
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
    """Return the constants of an airframe, to compare with simlink's default craft."""
    body = (craft.mass, craft.inertia, craft.rotors, craft.thrust_max, craft.torque_per_thrust, craft.drag)
    return *body, craft.battery.full
