"""The guides for autopilots against the files that they name."""

import math
import tomllib

import pytest

from onboard.config import GuidanceConfig
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from tests.support import documents
from tests.support.programs import ROOT


def test_the_parameter_file_holds_what_the_guide_says() -> None:
    rows = [line.split("#")[0].split() for line in _text("ardupilot-follow.parm").splitlines()]
    in_file = {name: float(value) for name, value in (row for row in rows if row)}
    in_guide: dict[str, float] = {}
    for table in documents.tables(documents.text("ardupilot")):
        for first, second, *_ in table:
            names, values = first.replace("`", "").split(", "), second.split(", ")
            if names[0].startswith(("FOLL_", "WPNAV_")):
                in_guide |= {name: float(value) for name, value in zip(names, values, strict=True)}
    assert in_file == in_guide
    assert in_file["FOLL_SYSID"] == tomllib.loads(_text("sitl.toml"))["leader_out"][0]["system"]


@pytest.mark.parametrize(("file", "guide"), [("ardupilot-serial.parm", "ardupilot"), ("px4-serial.params", "px4")])
def test_the_parameters_of_the_serial_port_are_those_of_the_guide(file: str, guide: str) -> None:
    rows = [line.split("#")[0].split() for line in _text(file).splitlines()]
    in_file = dict(row[:2] if len(row) == 2 else row[2:4] for row in rows if row)
    table, *_ = documents.tables(documents.section(guide, "Wiring"))
    assert in_file == {name.strip("`"): value for name, value, _ in table}


def test_the_parameter_file_of_px4_holds_what_the_guide_says_and_the_slot() -> None:
    rows = [line.split("\t") for line in _text("px4-follow.params").splitlines() if not line.startswith("#")]
    in_file = {name: float(value) for _, _, name, value, _ in rows}
    in_guide: dict[str, float] = {}
    for table in documents.tables(documents.text("px4")):
        for first, second, *_ in table:
            if first.startswith("`FLW_"):
                in_guide[first.strip("`")] = float(second)
    assert in_file == in_guide
    forward, right, _ = GuidanceConfig().slot_m
    assert math.hypot(forward, right) == in_file["FLW_TGT_DST"]
    assert abs(math.degrees(math.atan2(right, forward))) == in_file["FLW_TGT_FA"]
    assert {type_ for *_, type_ in rows} <= {"6", "9"}


def test_the_simulated_camera_is_configured_as_it_is() -> None:
    config, made = tomllib.loads(_text("sitl.toml")), tomllib.loads(daemon_config(load_scenario("sitl")))
    camera = {key: made["camera"][key] for key in config["camera"]}
    assert config["camera"] == camera
    assert config["estimator"]["leader"] == made["estimator"]["leader"]


def _text(name: str) -> str:
    return (ROOT / "configs" / name).read_text(encoding="utf-8")
