"""Mutants by chance, for `python -m tests.mutants --random N --seed S`: a table written by hand holds what its
authors thought of, a drawn one says what share of all wrong lines the tests see.

A line of all packages is drawn, then one of its changes, so that a matrix full of numbers counts once. The tests
that run are the nearest: those that the table names for the file, then those fewest imports away from it.
"""

import ast
import math
import random
from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Final

from tests.mutants.changes import Change, changes
from tests.mutants.table import ROOT, Mutant

PACKAGES: Final = ("onboard", "simlink", "studies")
MOST_FILES: Final = 10  # of tests that run for one mutant
CONFIDENCE: Final = 1.96  # standard deviations: an interval that holds the true share 19 times of 20


def draw(number: int, seed: int, table: Sequence[Mutant], folders: Sequence[str] = ()) -> list[Mutant]:
    """Draw mutants, other ones for each seed, from these folders or files; from all, if there are none.

    `table` says which are known to be equivalent to the right line, and which tests see a file.
    """
    rng = random.Random(seed)
    inside = [path for path in _sources() if not folders or any(_is_in(path, folder) for folder in folders)]
    lines = [(path, k) for path in inside for k in _by_line(path)]
    chosen = rng.sample(lines, min(number, len(lines)))
    return [_mutant(path, rng.choice(_by_line(path)[k]), table) for path, k in chosen]


def nearest(file: str, table: Sequence[Mutant]) -> tuple[str, ...]:
    """Test files for a source, the nearest first."""
    named = {test.partition("::")[0] for mutant in table if mutant.file == file for test in mutant.tests}
    steps = _steps(file)
    path = Path(file)

    def rank(test: str) -> tuple[bool, bool, int, int, str]:
        same_folder = Path(test).parent.name == path.parent.name
        imports = len(_imports(ROOT / test))
        return test not in named, path.stem not in Path(test).stem, steps[test] - same_folder, imports, test

    tests = [test for test in steps if Path(test).name.startswith("test_")]
    return tuple(sorted(tests, key=rank)[:MOST_FILES])


def interval(killed: int, decided: int) -> tuple[float, float]:
    """Wilson's interval of a share: within it lies that of all changes, 19 times of 20."""
    if not decided:
        return 0.0, 1.0
    z2 = CONFIDENCE**2 / decided
    share = killed / decided
    half = math.sqrt(z2 * share * (1.0 - share) + z2 * z2 / 4.0)
    return (share + z2 / 2.0 - half) / (1.0 + z2), (share + z2 / 2.0 + half) / (1.0 + z2)


def _is_in(path: Path, folder: str) -> bool:
    return path.is_relative_to(ROOT / folder)


def _mutant(path: Path, change: Change, table: Sequence[Mutant]) -> Mutant:
    text, file = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
    wrong = change.applied_to(text)
    line = text.count("\n", 0, change.start)
    before, after = text.splitlines()[line].strip(), wrong.splitlines()[line].strip()
    equivalent = [m.survives for m in table if m.file == file and m.survives and m.applied_to(text) == wrong]
    name = f"{file}:{line + 1} {before} -> {after}"
    return Mutant(name, file, text, wrong, nearest(file, table), "".join(equivalent[:1]))


@cache
def _sources() -> list[Path]:
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


@cache
def _by_line(path: Path) -> dict[int, list[Change]]:
    """The changes of a source by the line, from 0."""
    text = path.read_text(encoding="utf-8")
    found = defaultdict(list)
    for change in changes(text):
        found[text.count("\n", 0, change.start)].append(change)
    return dict(found)


@cache
def _steps(file: str) -> dict[str, int]:
    """How many imports lead to a source, by file, for all files that come to it."""
    steps, waiting = {file: 0}, [file]
    while waiting:
        current = waiting.pop(0)
        for user in _users().get(current, ()):
            if user not in steps:
                steps[user] = steps[current] + 1
                waiting.append(user)
    return steps


@cache
def _users() -> dict[str, list[str]]:
    """The files that import a file, by that file."""
    users = defaultdict(list)
    for path in [*_sources(), *sorted((ROOT / "tests").rglob("*.py"))]:
        for name in _imports(path):
            users[name].append(path.relative_to(ROOT).as_posix())
    return users


@cache
def _imports(path: Path) -> frozenset[str]:
    """The files of this repository that a file imports, at its top level or within functions."""
    named: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            named |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    folders = [ROOT.joinpath(*name.split(".")) for name in named]
    files = [f for folder in folders for f in (folder.with_suffix(".py"), folder / "__init__.py") if f.exists()]
    return frozenset(file.relative_to(ROOT).as_posix() for file in files)
