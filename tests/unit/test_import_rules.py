"""The floors of the house: who may import whom, read off the sources."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FLOORS = (
    {"errors", "loading"},
    {"geometry", "messages", "filters"},
    {"models", "ownship", "clocks", "wire", "schemas"},
    {"estimators", "links", "sinks"},
    {"config", "pipeline", "session", "scoring", "scorecard", "own_scoring", "traffic_scoring", "traffic_out"}
    | {"client", "view", "studies", "replay"},
    {"compiling", "daemon", "demo", "progress", "reporting", "watching"},
    {"cli"},
    {"__main__"},
)
FLOOR = {part: floor for floor, parts in enumerate(FLOORS) for part in parts}
OPEN_FLOORS = (1, 4, 5)  # whose parts may see each other
SHARED = {"geometry", "messages", "wire"}  # what simlink may see of onboard
PURE = {"pipeline", "filters", "models", "estimators", "geometry", "ownship", "clocks", "wire"}
RIM = {"asyncio", "socket", "time", "threading", "zenoh", "rerun", "selectors", "multiprocessing", "serial"}


def imports(source: str) -> Iterator[str]:
    """Every module a source names, function bodies included."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            yield from (f"{base}.{alias.name}" for alias in node.names)


def violations(root: Path) -> list[str]:
    """Imports under `root` that the rules forbid, one line each."""
    found = []
    for path in sorted([*root.glob("onboard/**/*.py"), *root.glob("simlink/**/*.py")]):
        package, part = (*path.relative_to(root).with_suffix("").parts, "")[:2]
        for name in imports(path.read_text(encoding="utf-8")):
            reason = forbidden(package, part, name)
            if reason:
                found.append(f"{path.relative_to(root)} imports {name}: {reason}")
    return found


def forbidden(package: str, part: str, name: str) -> str | None:
    """Why a part of a package may not import a name, None if it may."""
    if name.startswith("."):
        return "relative"
    top, target, *_ = (*name.split("."), "", "")
    if package == "onboard" and part in PURE and top in RIM:
        return "the synchronous core knows neither clock, socket nor thread"
    if top == "simlink" and package == "onboard":
        return None if part == "studies" else "only studies see the simulator"
    if top != "onboard" or part == "__init__" or target == "__version__":
        return None
    if package == "simlink":
        return None if target in SHARED else "not shared with the simulator"
    mine, theirs = FLOOR.get(part), FLOOR.get(target)
    if mine is None or theirs is None:
        return "a part without a floor"
    if theirs < mine or target == part or (theirs == mine and mine in OPEN_FLOORS):
        return None
    return f"floor {mine} does not see floor {theirs}"


def test_every_import_keeps_the_floors() -> None:
    assert violations(ROOT) == []


def test_all_parts_are_there_and_have_a_floor() -> None:
    parts = {p.stem for p in (ROOT / "onboard").iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert parts - {"__init__"} == set(FLOOR)


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("onboard/filters/bad.py", "import asyncio"),
        ("onboard/filters/bad.py", "from time import monotonic"),
        ("onboard/pipeline.py", "def f():\n    import zenoh"),
        ("onboard/filters/bad.py", "from onboard.models import camera_angles"),
        ("onboard/estimators/bad.py", "from onboard.links import link"),
        ("onboard/sinks/bad.py", "import onboard.estimators.leader"),
        ("onboard/wire/bad.py", "from onboard.config import Config"),
        ("onboard/wire/bad.py", "from onboard import clocks"),
        ("onboard/estimators/bad.py", "import rerun as rr"),
        ("onboard/daemon.py", "from onboard.cli import main"),
        ("onboard/daemon.py", "import simlink.world"),
        ("onboard/unheard_of.py", "from onboard.messages import Record"),
        ("onboard/wire/bad.py", "from . import tlog"),
        ("simlink/world.py", "from onboard.models import relative_motion"),
        ("simlink/motion.py", "def f():\n    from onboard.ownship import Ownship"),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / path).parent.mkdir(parents=True)
    (tmp_path / path).write_text(f"{line}\n", encoding="utf-8")
    assert len(violations(tmp_path)) == 1


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("onboard/estimators/good.py", "from onboard.ownship import Ownship"),
        ("onboard/studies/good.py", "from simlink.flight import fly"),
        ("onboard/session.py", "from onboard.config import Config"),
        ("onboard/links/good.py", "import asyncio"),
        ("simlink/world.py", "import numpy as np\nfrom onboard.geometry.rotations import slerp"),
    ],
)
def test_a_proper_import_is_let_be(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / path).parent.mkdir(parents=True)
    (tmp_path / path).write_text(f"{line}\n", encoding="utf-8")
    assert violations(tmp_path) == []


@pytest.mark.parametrize("module", ["onboard.pipeline", "onboard.cli", "simlink.world"])
def test_what_is_slow_to_load_is_not_loaded(module: str) -> None:
    slow = [
        "rerun",
        "scipy.spatial",
        "matplotlib",
        "pymavlink.mavutil",
        *(["zenoh"] if "onboard" in module else []),
    ]
    code = f"import sys, {module}; print([m for m in {slow} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
