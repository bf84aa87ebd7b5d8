"""The guides for autopilots against the files that they name."""

import tomllib

import pytest

from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from tests.support import documents
from tests.support.programs import ROOT


@pytest.mark.parametrize(
    ("file", "guide", "section"),
    [
        ("ardupilot-serial.parm", "ardupilot", "Wiring"),
        ("ardupilot-follow.parm", "ardupilot", "Parameters"),
        ("px4-serial.params", "px4", "Wiring"),
        ("px4-follow.params", "px4", "Parameters"),
    ],
)
def test_a_parameter_file_holds_what_the_guide_says(file: str, guide: str, section: str) -> None:
    rows = [line.split("#")[0].split() for line in _text(file).splitlines()]
    in_file = dict(row[:2] if len(row) == 2 else row[2:4] for row in rows if row)
    table, *_ = documents.tables(documents.section(guide, section))
    in_guide = {name.strip("`"): value for name, value, _ in table}
    assert in_file.keys() == in_guide.keys()
    assert [float(value) for value in in_file.values()] == [float(in_guide[name]) for name in in_file]


def test_the_simulated_camera_is_configured_as_it_is() -> None:
    config, made = tomllib.loads(_text("sitl.toml")), tomllib.loads(daemon_config(load_scenario("sitl")))
    camera = {key: made["camera"][key] for key in config["camera"]}
    assert config["camera"] == camera
    assert config["estimator"]["leader"] == made["estimator"]["leader"]


def _text(name: str) -> str:
    return (ROOT / "configs" / name).read_text(encoding="utf-8")
