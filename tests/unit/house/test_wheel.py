"""The wheel as somebody installs it: what is in it, and that it runs apart from this tree."""

import os
import shutil
import subprocess
import sys
import tomllib
from email.parser import Parser
from pathlib import Path
from zipfile import ZipFile

import pytest

from onboard import __version__
from onboard.compiled import machine
from tests.support.programs import ROOT

BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_wheel(sys.argv[1]))"
USE = """
import onboard, simlink, onboard.pipeline
from importlib.resources import files
from simlink.scenarios.scenario import load_scenario, scenario_names
from simlink.sensors import almanac
assert onboard.__file__.startswith(r"{place}"), onboard.__file__
almanac.load()
assert b"[[link]]" in (files("onboard") / "share" / "configs" / "companion.toml").read_bytes()
print(len(scenario_names()), load_scenario("mission").name, onboard.__version__)
"""
FOLDERS = ("onboard", "simlink", "studies", "tests/support", "benchmarks", "configs", "examples", "docs/notebooks")
FILES = ("pyproject.toml", "README.md", "LICENSE")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built of a copy, in which the build may leave what it likes, without a network."""
    tree, out = (tmp_path_factory.mktemp(name) for name in ("tree", "out"))
    for folder in FOLDERS:
        ignore = shutil.ignore_patterns("__pycache__", machine.OBJECTS, "*.egg-info")
        shutil.copytree(ROOT / folder, tree / folder, ignore=ignore, symlinks=True)
    for name in FILES:
        shutil.copy(ROOT / name, tree)
    built = subprocess.run(
        [sys.executable, "-c", BUILD, out], cwd=tree, capture_output=True, text=True, check=False, timeout=300
    )
    assert built.returncode == 0, built.stderr[-2000:]
    return out / built.stdout.splitlines()[-1]


def test_all_that_flies_is_in_the_wheel_and_nothing_else(wheel: Path) -> None:
    with ZipFile(wheel) as file:
        names = set(file.namelist())
    mine = {name for name in names if ".dist-info/" not in name}
    expected = {
        (Path(folder) / name).relative_to(ROOT).as_posix()
        for package in ("onboard", "simlink")
        for folder, _, inside in os.walk(ROOT / package, followlinks=True)
        for name in inside
        if not {"__pycache__", machine.OBJECTS} & {*Path(folder).parts}
    }
    assert mine == expected
    for needed in ("onboard/py.typed", "simlink/py.typed", "simlink/scenarios/mission.toml"):
        assert needed in mine
    assert any(name.endswith(".alm") for name in mine)
    assert any(name.endswith(".pyi") for name in mine)
    assert any(name.endswith("LICENSE") for name in names - mine)


@pytest.mark.parametrize("folder", ["configs", "examples"])
def test_configurations_and_examples_are_in_the_wheel_as_they_are_here(wheel: Path, folder: str) -> None:
    shared = f"onboard/share/{folder}/"
    with ZipFile(wheel) as file:
        found = {n.removeprefix(shared): file.read(n) for n in file.namelist() if n.startswith(shared)}
        modes = {n.removeprefix(shared): file.getinfo(n).external_attr >> 16 for n in file.namelist()}
    assert found == {path.name: path.read_bytes() for path in (ROOT / folder).iterdir() if path.is_file()}
    assert all(modes[name] & 0o100 for name in found if name.endswith(".sh"))


def test_its_metadata_are_those_of_the_project(wheel: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    with ZipFile(wheel) as file:
        (metadata,) = (file.read(n).decode() for n in file.namelist() if n.endswith(".dist-info/METADATA"))
        (points,) = (file.read(n).decode() for n in file.namelist() if n.endswith("entry_points.txt"))
    stated = Parser().parsestr(metadata)
    assert (stated["Name"], stated["License-Expression"]) == ("wingline", "BSD-3-Clause")
    assert stated["Version"] == __version__
    assert stated["Requires-Python"] == project["requires-python"]
    required = [r for r in stated.get_all("Requires-Dist") or [] if "extra ==" not in r]
    assert len(required) == len(project["dependencies"])
    for command, place in project["scripts"].items():
        assert f"{command} = {place}" in points


def test_it_runs_apart_from_this_tree(wheel: Path, tmp_path: Path) -> None:
    place = tmp_path / "site"
    with ZipFile(wheel) as file:
        file.extractall(place)
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    commands = "".join(
        f"from {module} import {name}\n" for module, name in (s.split(":") for s in scripts.values())
    )
    code = f"import sys; sys.path.insert(0, r'{place}')" + USE.format(place=place) + commands
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    count, name, _ = ran.stdout.split()
    assert int(count) > 30
    assert name == "mission"
