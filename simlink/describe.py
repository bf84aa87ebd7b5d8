"""What a daemon must be told to fly a scenario: its camera, and what is known of the leader beforehand."""

from simlink.scenario import Scenario


def daemon_config(scenario: Scenario) -> str:
    """Configuration of `onboard` in TOML. The wingspan is the nominal one, as well known as the scenario draws it;
    our own attitude is said to be exact where the scenario makes it so."""
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
    lines += ["", "[estimator.leader]", f"size_prior_m = {leader.size}", 'leader_class = "fixed_wing"']
    if leader.size_sigma_percent > 0:
        lines.append(f"size_prior_sigma_m = {leader.size * leader.size_sigma_percent / 100:.6g}")
    if scenario.nav.attitude_deg.sigma == 0:
        lines += ["own_tilt_sigma_deg = 0.0", "own_yaw_sigma_deg = 0.0"]
    return "\n".join(lines)
