"""The floors of the house: who may import whom, read off the sources; at most so many parts and arrows."""

import ast
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[3]
FLOORS = (
    {"arrays", "compiled", "units"},
    {"geometry", "messages"},
    {"clocks", "filters", "links", "sinks", "terminal", "wire"},
    {"models", "ownship"},
    {"estimators", "health", "scoring"},
    {"client", "config", "view"},
    {"autopilot", "pipeline"},
    {"analysis", "daemon"},
    {"commands"},
    {"__main__"},
)
FLOOR = {part: floor for floor, parts in enumerate(FLOORS) for part in parts}
FACE = {"__version__", "UserError", "with_extra"}  # `onboard` itself, which every part loads anyway
STRANGERS = {"estimators", "links", "sinks"}  # never see each other
# Parts of parts, the lower first; those that stand on one floor do not see each other.
INSIDE = {
    "onboard.estimators": ({"kit"}, {"leader", "oh_johnson", "own_state", "traffic"}),
    "onboard.estimators.leader": (
        *(
            {"assumptions"},
            {"association", "config"},
            {"image"},
            {"hypotheses"},
            {"reports"},
            {"tracks"},
            {"estimator"},
        ),
    ),
    "onboard.estimators.leader.tracks": (
        *({"doubts", "life_cycle"}, {"fusing"}, {"decisions", "report"}, {"track"}),
    ),
    "onboard.estimators.leader.image": (
        *({"camera_pose"}, {"pose", "shape"}, {"measurement"}, {"prepare"}, {"detector"}),
    ),
    "onboard.wire": (*({"documents", "odometry"}, {"mavlink", "ros"}, {"logs"}, {"datagrams", "surplus"}),),
    "onboard.analysis": ({"calibration", "exports", "parallel"}, {"flights"}, {"report"}),
    "onboard.estimators.kit": ({"frame", "history", "life_cycle"}, {"peer_position", "reports"}),
    "studies": ({"report"}, {"tracking", "closed_loop"}, {"*"}, {"together"}, {"command"}, {"__main__"}),
    "simlink": (
        *({"scenarios"}, {"world"}, {"sensors"}, {"traffic"}, {"autopilot"}, {"simulation"}),
        *({"encounters", "log", "server"}, {"cli"}, {"__main__"}),
    ),
}
OURS = ("onboard", "simlink", "studies", "benchmarks")
ABOVE = {"studies", "benchmarks"}  # both see onboard and simlink; nobody sees them
SHARED = {"geometry", "messages", "units", "wire"}  # what simlink may see of onboard
PURE = {"pipeline", "filters", "models", "estimators", "geometry", "ownship", "clocks", "wire", "health"}
RIM = {"asyncio", "socket", "time", "threading", "zenoh", "rerun", "selectors", "multiprocessing", "serial"}
ENCODER = "onboard.wire.mavlink.encode"
PRIVATE_TO = {"onboard.filters.kernels": "onboard.filters"}
MOST_PARTS = 26
MOST_ARROWS = 98


class Import(NamedTuple):
    """A module (whole name) that is imported, and a name that is taken from it; "" for the module itself."""

    module: str
    name: str


@cache
def imports(source: str) -> tuple[Import, ...]:
    """Every import of a source, function bodies included."""
    found: list[Import] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [Import(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            found += [Import(base, alias.name) for alias in node.names]
    return tuple(found)


def sources(root: Path) -> dict[str, str]:
    """The text of every module by its whole name; a package's is under the package's name."""
    found = {}
    for folder in OURS:
        for path in sorted(root.glob(f"{folder}/**/*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path.read_text(encoding="utf-8")
    return found


def violations(root: Path) -> list[str]:
    """Imports under `root` that the rules forbid, one line each."""
    found = []
    for module, text in sources(root).items():
        for one in imports(text):
            reason = forbidden(module, one)
            if reason:
                found.append(f"{module} imports {one.name or 'all'} of {one.module}: {reason}")
    return found


def forbidden(module: str, one: Import) -> str | None:
    """Why a module may not import this, None if it may."""
    if one.module.startswith("."):
        return "relative"
    target = f"{one.module}.{one.name}" if one.name else one.module
    package, part, *_ = (*module.split("."), "")
    top, their_part, *_ = (*target.split("."), "")
    if package == "onboard" and part in PURE and top in RIM:
        return "the synchronous core knows neither clock, socket nor thread"
    if top not in OURS:
        return None
    if is_private(module, one):
        return "private"
    if top == package:
        return between(part, their_part) if top == "onboard" and part != their_part else inside(module, target)
    if top in ABOVE:
        return f"{top} stands above all"
    if package in ABOVE:
        return None
    if top == "simlink":
        return "what flies does not see the simulator"
    return None if their_part in SHARED else "not shared with the simulator"


def between(mine: str, theirs: str) -> str | None:
    """Why a part of onboard may not import another."""
    if not mine or theirs in FACE:
        return None
    if mine not in FLOOR or theirs not in FLOOR:
        return "a part without a floor"
    if {mine, theirs} <= STRANGERS:
        return "strangers"
    return None if FLOOR[theirs] < FLOOR[mine] else f"floor {FLOOR[mine]} does not see floor {FLOOR[theirs]}"


def inside(module: str, target: str) -> str | None:
    """Why a part of a part may not import another."""
    for package, floors in INSIDE.items():
        if module.startswith(f"{package}.") and target.startswith(f"{package}."):
            depth = package.count(".") + 1
            mine, theirs = module.split(".")[depth], target.split(".")[depth]
            below, here = floor_of(theirs, floors), floor_of(mine, floors)
            if mine != theirs and below >= here:
                return f"{mine} does not see {theirs}"
    return None


def floor_of(part: str, floors: tuple[set[str], ...]) -> int:
    """Which floor a part of a part stands on; "*" is any that is not named."""
    named = [i for i, parts in enumerate(floors) if part in parts]
    return named[0] if named else next(i for i, parts in enumerate(floors) if "*" in parts)


def is_private(module: str, one: Import) -> bool:
    """Whether what is imported belongs to a package that the module is not in."""
    for package, owner in PRIVATE_TO.items():
        if f"{one.module}.".startswith(f"{package}.") and not f"{module}.".startswith(f"{owner}."):
            return True
    parts = [*one.module.split("."), one.name]
    for i, part in enumerate(parts):
        if part.startswith("_") and not part.startswith("__"):
            owner = ".".join(parts[:i]) if i < len(parts) - 1 else one.module.rpartition(".")[0]
            return not module.startswith(f"{owner}.")
    return False


def files(root: Path) -> dict[str, set[str]]:
    """The modules that each module of the house imports."""
    texts = sources(root)
    graph: dict[str, set[str]] = {}
    for module, text in texts.items():
        named = {f"{one.module}.{one.name}" for one in imports(text)} | {one.module for one in imports(text)}
        # a package's face is imported with every module in it: what counts is the module
        graph[module] = {name for name in named if name in texts and not is_face(name, texts)} - {module}
    return graph


def is_face(name: str, texts: Mapping[str, str]) -> bool:
    """Whether a module is a package that has others in it."""
    return any(other.startswith(f"{name}.") for other in texts)


def part_of(module: str) -> str:
    """The part a module is drawn in: of onboard its files and folders, else the package."""
    return ".".join(module.split(".")[: 2 if module.startswith("onboard.") else 1])


def drawing(root: Path) -> tuple[set[str], set[tuple[str, str]]]:
    """Parts above the ground floor, on which every part stands, and arrows between them, read off all imports."""
    parts = {part_of(module) for module in sources(root)} - {"onboard", *(f"onboard.{part}" for part in FLOORS[0])}
    arrows = set()
    for module, text in sources(root).items():
        for one in imports(text):
            for name in (f"{one.module}.{one.name}", one.module):
                if part_of(name) in parts and part_of(module) in parts and part_of(name) != part_of(module):
                    arrows.add((part_of(module), part_of(name)))
                    break
    return parts, arrows


def test_every_import_keeps_the_floors() -> None:
    assert violations(ROOT) == []


def test_all_that_leaves_over_mavlink_is_encoded_in_one_place() -> None:
    """Which refuses what it does not list: no command that moves a vehicle."""
    takers = {m for m, text in sources(ROOT).items() if Import(ENCODER, "MavlinkEncoder") in imports(text)}
    assert {m for m in takers if m.startswith("onboard.")} == {"onboard.autopilot.sent"}


def test_no_files_import_each_other_in_a_circle() -> None:
    try:
        TopologicalSorter(files(ROOT)).prepare()
    except CycleError as error:
        pytest.fail(f"a circle: {' -> '.join(error.args[1])}")


def test_a_circle_is_found(tmp_path: Path) -> None:
    for name, other in (("a", "b"), ("b", "a")):
        path = tmp_path / f"onboard/filters/{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"from onboard.filters import {other}\n", encoding="utf-8")
    with pytest.raises(CycleError):
        TopologicalSorter(files(tmp_path)).prepare()


def test_the_drawing_stays_small() -> None:
    parts, arrows = drawing(ROOT)
    assert len(parts) <= MOST_PARTS
    assert len(arrows) <= MOST_ARROWS, "\n".join(f"{a} -> {b}" for a, b in sorted(arrows))


def test_all_parts_are_there_and_have_a_floor() -> None:
    parts = {p.stem for p in (ROOT / "onboard").iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert parts - {"__init__"} == set(FLOOR)


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("onboard/filters/bad.py", "import asyncio"),
        ("onboard/pipeline.py", "def f():\n    import zenoh"),
        ("onboard/models/bad.py", "from onboard.filters.kernels import linear"),
        ("onboard/models/bad.py", "from onboard.filters.belief import _refuse"),
        ("onboard/estimators/bad.py", "from onboard.links import link"),
        ("onboard/estimators/leader/bad.py", "from onboard.estimators.traffic import track"),
        ("studies/tracking/bad.py", "from studies.traffic import study"),
        ("onboard/wire/bad.py", "from onboard.config import Config"),
        ("onboard/daemon.py", "import simlink.world"),
        ("studies/traffic/bad.py", "from benchmarks import live"),
        ("onboard/unheard_of.py", "from onboard.messages import Record"),
        ("onboard/wire/bad.py", "from . import tlog"),
        ("simlink/world/bad.py", "def f():\n    from onboard.ownship import Ownship"),
        ("simlink/world/bad.py", "from simlink.sensors import camera"),
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
        ("studies/traffic/good.py", "from studies.tracking import outcomes"),
        ("onboard/filters/good.py", "from onboard.filters.kernels import linear"),
        ("onboard/links/good.py", "from onboard import UserError"),
        ("simlink/world/good.py", "import numpy as np\nfrom onboard.geometry.rotations import slerp"),
    ],
)
def test_a_proper_import_is_let_be(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / path).parent.mkdir(parents=True)
    (tmp_path / path).write_text(f"{line}\n", encoding="utf-8")
    assert violations(tmp_path) == []


@pytest.mark.parametrize("module", ["onboard.pipeline", "onboard.commands.cli", "simlink.world.truth"])
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


def test_a_flight_behind_a_leader_loads_no_filter_of_others() -> None:
    """Every compiled function that is loaded costs half a megabyte of a flight, and time at its start."""
    code = (
        "import sys\nfrom onboard.config import load_config\nfrom onboard.daemon import Daemon\n"
        "config = load_config(None, ('estimator.leader.size_prior_m=2.0', 'zenoh.enabled=false'))\n"
        "Daemon(config, report=print)\n"
        "print(*sorted(m for m in sys.modules if m.startswith('onboard.filters.kernels.')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["onboard.filters.kernels.cholesky", "onboard.filters.kernels.definite"]
