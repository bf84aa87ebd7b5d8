"""docs/configuration.md and configs/*.toml against the records: every key, every default, and files that load."""

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest

from onboard.config import Config, LeaderOutConfig, LinkConfig, OwnErrors, load_config, parse_config
from onboard.config.sections import DERIVED_KEYS
from onboard.estimators import config_type, known, load
from onboard.estimators.leader.config import BroadcastConfig, RangeConfig
from onboard.messages import Record, TargetClass
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario, parse_scenario, scenario_names
from tests.support import documents
from tests.support.programs import ROOT

CONFIGS = sorted((ROOT / "configs").glob("*.toml"))
REQUIRED = "required"
UNSET = "–"


def sections() -> dict[str, type[Record]]:
    """Each section of the configuration, by its heading, with its record."""
    special = {"link", "leader_out", "estimator", "cameras", "target"}
    plain = {f.name: f.type for f in msgspec.structs.fields(Config) if f.name not in special}
    (custom,) = (f.type for f in msgspec.structs.fields(config_type("own_state")) if f.name == "custom")
    return {
        "`[[link]]`": LinkConfig,
        "`[[leader_out]]`": LeaderOutConfig,
        **{f"`[{name}]`": record for name, record in plain.items()},
        "`[target.CLASS]`": TargetClass,
        "`[ownship.errors]`": OwnErrors,
        **{f"`[estimator.{name}]`": config_type(name) for name in known()},
        "`[estimator.leader.broadcast]`": BroadcastConfig,
        "`[estimator.leader.range]`": RangeConfig,
        "`[estimator.own_state.custom]`": get_args(custom)[0],
    }


def keys(record: type[Record]) -> dict[str, Any]:
    """Every key of a section with its default, those of a table of numbers each by itself."""
    found: dict[str, Any] = {}
    for field in msgspec.structs.fields(record):
        if field.name in DERIVED_KEYS:
            continue
        default = field.default
        if field.default_factory is not msgspec.NODEFAULT:
            default = field.default_factory()
        if field.required:
            found[field.name] = REQUIRED
        elif isinstance(default, Record):
            continue  # a section of its own
        elif isinstance(default, dict) and default:
            found |= {f"{field.name}.{name}": value for name, value in default.items()}
        else:
            found[field.name] = default
    return found


def in_toml(default: Any) -> str:
    """A default as the page has it."""
    if default is None or default == REQUIRED:
        return UNSET if default is None else REQUIRED
    return f"`{_value(default)}`"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    return "{}" if value == {} else format(value, ".10g")


@pytest.mark.parametrize("heading", sections())
def test_the_page_has_every_key_of_a_section_with_its_default(heading: str) -> None:
    tables = documents.tables(documents.section("configuration", heading).split("\n###")[0])
    shown = [(name, default) for table in tables for key, default, _ in table for name in documents.names(key)]
    assert shown == [(key, in_toml(default)) for key, default in keys(sections()[heading]).items()]


def test_the_page_has_every_section_and_no_other() -> None:
    headings = re.findall(r"^##+ (.*)$", documents.text("configuration"), re.MULTILINE)
    assert sorted(headings) == sorted(sections())


def test_defaults_of_links_are_as_the_page_says() -> None:
    shown = documents.names(documents.section("configuration", "`[[link]]`").split("|")[0])
    assert shown == [*(v for link in load_config(None).link for v in (link.name, link.url)), "autopilot = false"]


def exists(key: str) -> bool:
    """Whether a dotted key is one of the configuration."""
    section, _, name = key.rpartition(".")
    return key in known_keys() or name in known_keys().get(section, {})


@cache
def known_keys() -> dict[str, Any]:
    return {heading.strip("`[]"): keys(record) for heading, record in sections().items()}


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_keys_and_sections_named_in_the_text_exist(path: Path) -> None:
    text = documents.text(path)
    tops = {field.name for field in msgspec.structs.fields(Config)}
    for name in re.findall(r"`\[+([a-z_.]+)\]+[` ]", text):
        assert exists(name) or exists(name.rpartition(".")[0] or name) or name == "autopilot.rates_hz", name
    for key in re.findall(r"`((?:[a-z_]+\.)+[a-z_]+)(?: = [^`]*)?`", text):
        if key.split(".")[0] in tops and not key.endswith((".py", ".toml", ".md")):
            assert exists(key), key


@pytest.mark.parametrize("path", documents.ALL, ids=documents.name)
def test_toml_in_the_documents_loads(path: Path) -> None:
    text = documents.text(path)
    for block in documents.blocks(text, "toml"):
        parse_config(tomllib.loads(block))
    for setting in re.findall(r"^    .*--set (\S+)", text.replace("\\\n", " "), re.MULTILINE):
        load_config(None, (setting,))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.name)
def test_configuration_files_load(path: Path) -> None:
    config = load_config(path)
    for name, section in config.estimator.items():
        load(name).Estimator(section, config.camera_model())
    assert all("0.0.0.0" not in link.url for link in config.link)  # noqa: S104 - what must not be there
    assert all(address.startswith("tcp/127.0.0.1:") for address in config.zenoh.listens())


@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.name)
def test_what_is_commented_out_loads_too(path: Path) -> None:
    """TOML behind a # is offered to the reader: with the # away its keys and sections exist."""
    lines = path.read_text(encoding="utf-8").splitlines()
    offered = [re.sub(r"^# (?=\[|\w+ = )", "", line) for line in lines]
    assert offered != lines or path.name in {"demo.toml", "router.toml"}
    table = tomllib.loads("\n".join(offered))
    named = {link["name"] for link in table.get("link", ())} | {"autopilot", "camera"}
    for section in ("odometry", "traffic_out"):  # their links are the reader's
        if section in table:
            table[section]["link"] = sorted(named)[0]
    parse_config(table)


def test_demo_toml_is_what_the_demo_uses(tmp_path: Path) -> None:
    """Ports aside: the configuration of the demo is made by `simlink config`."""
    made = tmp_path / "mission.toml"
    made.write_text(daemon_config(load_scenario("mission")))
    used, written = load_config(made), load_config(ROOT / "configs" / "demo.toml")
    assert written == used  # the defaults of links and Zenoh among them


@pytest.mark.parametrize("changed", ["", "[quadrotor]\nmass = 0.6"])
def test_the_daemon_is_told_the_nominal_craft(changed: str, tmp_path: Path) -> None:
    """By its name, or by its constants where it has none."""
    scenario = parse_scenario(f"extends = 'mission'\n{changed}", "mine")
    (tmp_path / "x.toml").write_text(daemon_config(scenario))
    told, craft = load_config(tmp_path / "x.toml").estimator["own_state"].known_airframe(), scenario.quadrotor
    assert craft is not None
    assert (told.mass_kg, told.inertia_kg_m2, told.rotors) == (craft.mass, craft.inertia, craft.rotors)
    assert (told.thrust_max_n, told.torque_per_thrust_m) == (craft.thrust_max, craft.torque_per_thrust)
    assert told.drag_per_s == craft.drag
    assert told.full_voltage_v in {None, craft.battery.full}


@pytest.mark.parametrize("scenario", scenario_names())
def test_each_scenario_has_a_configuration_that_loads(scenario: str, tmp_path: Path) -> None:
    described = load_scenario(scenario)
    (tmp_path / "x.toml").write_text(daemon_config(described))
    config = load_config(tmp_path / "x.toml")
    assert config.camera.f_px == described.camera.f_px
    assert config.camera.mount_rpy_deg == described.camera.mount_rpy_deg
    # nobody tells a daemon how large the errors are
    assert config.ownship == load_config(None).ownship
    leader = tomllib.loads(daemon_config(described))["estimator"]["leader"]
    beside = {*leader.pop("broadcast", {}), *leader.pop("range", {})}
    assert set(leader) <= {"size_prior_m", "leader_class", "center_on_wing"}
    assert beside <= {"system", "icao", "trusted", "sensor"}
    own = tomllib.loads(daemon_config(described))["estimator"].get("own_state", {})
    assert set(own) <= {"airframe", "custom"}
    assert tomllib.loads(daemon_config(described))["estimator"].get("traffic", {}) == {}
    if described.follow is not None:  # where its autopilot is to be led, and on which link
        (out,) = config.leader_out
        assert (config.guidance.slot_m, out.link) == (described.follow.offset, config.link[0].name)
        assert out.rates_hz == {"SET_POSITION_TARGET_LOCAL_NED": 25.0}
