"""README.md against the program: what it names exists, and means what it says."""

import argparse
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from onboard.commands import cli
from onboard.config import Config, load_config
from onboard.estimators import load
from onboard.messages import schemas
from simlink import cli as simlink_cli
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario, scenario_names
from tests.support import readme
from tests.support.programs import ROOT

CONFIGS = sorted((ROOT / "configs").glob("*.toml"))


def subcommands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    (action,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return dict(action.choices)


def test_schema_section_is_what_the_program_says() -> None:
    section = re.search(r"<!-- schema: begin[^>]*-->\n(.*)\n<!-- schema: end -->", readme.TEXT, re.DOTALL)
    assert section is not None
    assert section[1].strip() == schemas.describe().strip()


def test_every_command_in_the_table_parses() -> None:
    calls = [call for what, _ in readme.rows("What it does") for call in re.findall(r"`([^`]+)`", what)]
    assert {call.split()[0] for call in calls} == {"onboard", "simlink"}
    named = {"onboard": set[str](), "simlink": set[str]()}
    for call in calls:
        program, command, *arguments = call.split()
        named[program].add(command)
        parser = subcommands(cli.parser() if program == "onboard" else simlink_cli._parser())[command]
        flags = {flag for action in parser._actions for flag in action.option_strings}
        assert {word.strip("[]") for word in arguments if "--" in word} <= flags, call
    assert named["onboard"] == set(subcommands(cli.parser()))
    assert named["simlink"] == set(subcommands(simlink_cli._parser()))


def test_every_call_in_the_text_parses() -> None:
    """Those in indented blocks as they stand; of those in backticks, which may be cut short, the flags."""
    for command, rest in re.findall(r"`onboard ([a-z]+)([^`]*)`", readme.TEXT):
        flags = {flag for action in subcommands(cli.parser())[command]._actions for flag in action.option_strings}
        assert set(re.findall(r"--[a-z]+", rest)) <= flags
    calls = re.findall(r"^    (onboard (?:.*\\\n)*.*)$", readme.TEXT.replace("\\\n", " "), re.MULTILINE)
    assert calls
    for call in calls:
        cli.parser().parse_args(call.split("#")[0].split()[1:])


def test_every_make_target_exists() -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"make ([a-z]+)\b", readme.TEXT)) - {"git"}
    assert {"demo", "test"} <= targets
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def configured(key: str) -> Any:
    """The default under a dotted key."""
    value: Any = load_config(None)
    for part in key.split("."):
        value = value[part] if isinstance(value, dict) else getattr(value, part)
    return value


DEFAULTS = {  # key -> default, as the README's table gives them
    "estimator.leader.size_prior_m": 2.0,
    "estimator.leader.size_prior_sigma_m": None,
    "estimator.leader.leader_class": "multirotor",
    "estimator.leader.center_on_wing": False,
    "estimator.leader.filter": "wing-line",
    "estimator.leader.own_tilt_sigma_deg": 0.3,
    "estimator.leader.own_yaw_sigma_deg": 1.0,
    "estimator.leader.own_velocity_sigma_m_s": 0.1,
    "estimator.leader.delay_sigma_s": 0.0,
    "estimator.leader.validity_timeout_s": 2,
    "estimator.leader.reset_timeout_s": 10,
    "camera.mount_rpy_deg": (0, 0, 0),
    "camera.mount_offset_m": (0, 0, 0),
    "camera.f_px": 554.256,
    "camera.width_px": 640,
    "camera.height_px": 480,
    "camera.sigma_px": 1,
    "delay.local_position_s": None,
    "delay.global_position_s": None,
    "delay.gps_s": None,
    "delay.attitude_s": None,
    "delay.imu_s": None,
    "delay.camera_s": None,
    "autopilot.system": 0,
    "autopilot.rates_hz.NAME": 50,
    "zenoh.listen": ("tcp/127.0.0.1:7447",),
    "zenoh.connect": (),
    "zenoh.mode": "router",
    "zenoh.vehicle": "1",
    "recorder.path": None,
}


def test_every_configuration_key_named_exists_with_the_default_shown() -> None:
    documented = {name: default for keys, default, _ in readme.rows("Configuration") for name in spelled(keys)}
    assert set(documented) == set(DEFAULTS)
    for key, default in DEFAULTS.items():
        found = configured(key.replace(".NAME", ".ATTITUDE_QUATERNION"))
        assert found == default, key
    for key, shown in documented.items():
        value = DEFAULTS[key]
        if isinstance(value, bool):
            assert str(value).lower() in shown, key
        elif isinstance(value, str) and value not in {"router", "1"}:
            assert value in shown, key
        elif isinstance(value, (int, float)) and key != "autopilot.system":
            assert f"{value:g}" in shown, (key, shown)


def spelled(cell: str) -> list[str]:
    return readme.names(cell)


def test_keys_named_in_the_text_exist() -> None:
    for key in ("zenoh.config_file", "estimator.leader.own_tilt_sigma_deg"):
        configured(key)
    for name in re.findall(r"`\[(\w+)\]`", readme.TEXT):
        assert name in {f.name for f in msgspec.structs.fields(Config)}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.name)
def test_configuration_files_load(path: Path) -> None:
    config = load_config(path)
    for name, section in config.estimator.items():
        load(name).Estimator(section, config.camera_model())
    assert all("0.0.0.0" not in link.url for link in config.link)  # noqa: S104 - what must not be there
    assert all(address.startswith("tcp/127.0.0.1:") for address in config.zenoh.listen)


def test_there_are_the_configuration_files() -> None:
    assert [p.name for p in CONFIGS] == ["companion.toml", "demo.toml", "fleet.toml", "traffic.toml"]


def test_demo_toml_is_what_the_demo_uses(tmp_path: Path) -> None:
    """Ports aside: the configuration of the demo is made by `simlink config`."""
    made = tmp_path / "formation.toml"
    made.write_text(daemon_config(load_scenario("formation")))
    used, written = load_config(made), load_config(ROOT / "configs" / "demo.toml")
    assert written == used  # the defaults of links and Zenoh among them


@pytest.mark.parametrize("scenario", scenario_names())
def test_each_scenario_has_a_configuration_that_loads(scenario: str, tmp_path: Path) -> None:
    described = load_scenario(scenario)
    (tmp_path / "x.toml").write_text(daemon_config(described))
    config = load_config(tmp_path / "x.toml")
    assert config.camera.f_px == described.camera.f_px
    assert config.camera.mount_rpy_deg == described.camera.mount_rpy_deg
    exact = described.nav.attitude_deg.sigma == 0
    assert (config.estimator["leader"].own_tilt_sigma_deg == 0) == exact


def test_changelog_has_an_unreleased_part_that_names_every_command() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    unreleased = text.split("## Unreleased", 1)[1]
    for command in subcommands(cli.parser()):
        assert f"onboard {command}" in unreleased


def test_files_that_the_readme_points_to_exist() -> None:
    for target in re.findall(r"\]\((?!http|#)([^)]+)\)", readme.TEXT):
        assert (ROOT / target).exists(), target


def test_module_and_command_are_one() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "onboard", "--version"], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert re.fullmatch(r"wingline \d+\.\d+\.\d+\n", done.stdout)
