"""The configuration that a daemon needs for a scenario: camera, prior knowledge of the leader, own sensors'
errors."""

import math

from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.traffic import TrafficScene
from simlink.scenarios.vehicle import Nav


def daemon_config(scenario: Scenario) -> str:
    """Configuration of `onboard` in TOML. The prior of the leader's size is the nominal size with the scenario's
    sigma; our own attitude is declared exact where the scenario has no error in it."""
    camera, leader = scenario.camera, scenario.leader
    lines = [
        f"# Made by `simlink config {scenario.name}`.",
        "",
        "[camera]",
        f'name = "{camera.name}"',
        f"f_px = {camera.f_px}",
        f"width_px = {camera.width_px}",
        f"height_px = {camera.height_px}",
        f"mount_rpy_deg = {list(camera.mount_rpy_deg)}",
        f"mount_offset_m = {list(camera.mount_offset)}",
    ]
    lines += [f"sigma_px = {camera.sigma_px}"] if camera.sigma_px > 0 else []
    kind = "multirotor" if scenario.follower.attitude == "hover" else "fixed_wing"
    lines += ["", "[estimator.leader]", f"size_prior_m = {leader.size}", f'leader_class = "{kind}"']
    lines.append("center_on_wing = true")
    if leader.size_sigma_percent > 0:
        lines.append(f"size_prior_sigma_m = {leader.size * leader.size_sigma_percent / 100:.6g}")
    lines.append(f"own_velocity_sigma_m_s = {scenario.nav.velocity.sigma:.6g}")
    if scenario.nav.attitude_deg.sigma == 0:
        lines += ["own_tilt_sigma_deg = 0.0", "own_yaw_sigma_deg = 0.0"]
    if scenario.follow is not None:
        lines += ["", "[[leader_out]]", 'link = "autopilot"']
    if scenario.quadrotor is not None:
        lines += _own_state(scenario.quadrotor, scenario)
    if scenario.traffic.aircraft:
        lines += ["", *_traffic(scenario.traffic, scenario.nav)]
    return "\n".join(lines)


def _own_state(craft: Quadrotor, scenario: Scenario) -> list[str]:
    """The section of the own-state estimator: the nominal craft, and the noise of its measurements."""
    nav, gps = scenario.nav, scenario.gps
    rotors = ", ".join(f"[{x}, {y}, {sense:.0f}]" for x, y, sense in craft.rotors)
    lines = ["", "[delay]", f"gps_s = {gps.delay}", "", "[estimator.own_state]", 'airframe = "custom"']
    if min(*nav.attitude_white, nav.rates_white) > 0:
        lines.append(f"attitude_sigma_deg = {[round(math.degrees(x), 4) for x in nav.attitude_white]}")
        lines.append(f"rates_sigma_deg_s = {math.degrees(nav.rates_white):.4g}")
    if min(gps.position_white) > 0:
        lines.append(f"gps_position_sigma_m = {list(gps.position_white)}")
    if scenario.imu.accel_bias > 0:
        lines.append(f"bias_sigma_m_s2 = {scenario.imu.accel_bias}")
    if nav.attitude_deg.sigma == 0:
        lines += ["own_tilt_sigma_deg = 0.0", "own_yaw_sigma_deg = 0.0"]
    return [
        *lines,
        "",
        "[estimator.own_state.custom]",
        f"mass_kg = {craft.mass}",
        f"inertia_kg_m2 = {list(craft.inertia)}",
        f"rotors = [{rotors}]",
        f"thrust_max_n = {craft.thrust_max}",
        f"torque_per_thrust_m = {craft.torque_per_thrust}",
        f"motor_time_s = {craft.motor_time}",
        f"drag_per_s = {craft.drag}",
    ]


def _traffic(scene: TrafficScene, nav: Nav) -> list[str]:
    """The section of the traffic estimator: errors of reports, of our radar and of our own navigation, as data
    sheets give them.

    A quantisation step counts as a uniform error over its width. The step of an altitude persists over several
    reports in level flight; it counts 1.6 times, which is the error left in the mean of a minute. Reports are
    compared with our own position, so its error adds.
    """
    lines = ["[estimator.traffic]"]
    for name, reports in (("adsb", scene.adsb), ("peer", scene.peer)):
        earliest, latest = reports.latency
        place = math.hypot(reports.position_white, _uniform_sigma(reports.position_step))
        speed = math.hypot(reports.velocity_white, _uniform_sigma(reports.velocity_step))
        lines += [
            f"{name}_latency_s = {(earliest + latest) / 2:.6g}",
            f"{name}_latency_sigma_s = {_uniform_sigma(latest - earliest):.6g}",
            f"{name}_position_sigma_m = {place:.6g}",
            f"{name}_velocity_sigma_m_s = {speed:.6g}",
        ]
    adsb, attitude = scene.adsb, nav.attitude_deg
    bias = math.hypot(adsb.position.sigma, nav.position.sigma)
    altitude = math.hypot(adsb.position_white, 1.6 * _uniform_sigma(adsb.altitude_step))
    return [
        *lines,
        f"adsb_altitude_sigma_m = {max(altitude, 0.1):.6g}",
        f"report_bias_m = {max(bias, 0.1):.6g}",
        f"report_bias_altitude_m = {max(bias, 0.1):.6g}",
        f"peer_bias_m = {max(math.hypot(scene.peer.position.sigma, nav.position.sigma), 0.1):.6g}",
        f"report_bias_time_s = {adsb.position.time:.6g}",
        f"gnss_range_sigma_m = {scene.receiver.sigma:.6g}",
        f"gnss_rate_sigma_m_s = {scene.receiver.rate_sigma:.6g}",
        f"gnss_bias_m = {max(nav.position.sigma, 0.1):.6g}",
        f"radar_glint_m = {scene.radar.glint:.6g}",
        f"own_yaw_sigma_deg = {attitude.sigma:.6g}",
        f"own_tilt_sigma_deg = {attitude.sigma:.6g}",
        f"own_attitude_time_s = {attitude.time:.6g}",
        f"own_position_sigma_m = {nav.position.sigma:.6g}",
        f"own_position_time_s = {nav.position.time:.6g}",
        f"own_velocity_sigma_m_s = {nav.velocity.sigma:.6g}",
    ]


def _uniform_sigma(width: float) -> float:
    """Standard deviation of a uniform distribution over a width."""
    return width / math.sqrt(12)
