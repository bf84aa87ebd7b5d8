"""Measures of the code's growth, counted in the sources."""

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from onboard.compiled.sources import needed_by
from onboard.messages import invalidate
from tests.support.programs import ROOT

OF_SCORES = ("scoring", "view", "analysis", "commands")  # there `valid` is a count, or shown
OURS = ("onboard", "simlink", "studies", "benchmarks")
KERNELS = "kernel("
COUNT_OF_STATES = {"N", "BASE", "STATE_SIZE"}  # what a module calls the length of its state vector
PLAIN = {0, 1, 2, 0.5}  # numbers that choose nothing


class Function(NamedTuple):
    """A function, the number of its arguments, and whether arguments and result have types."""

    name: str
    arguments: int
    is_kernel: bool
    is_typed: bool


def sets_valid() -> Counter[str]:
    """The files of `onboard` that set `valid` of a record, and at how many places."""
    found: Counter[str] = Counter()
    for path in _files("onboard"):
        name = path.relative_to(ROOT).as_posix()
        if name.split("/")[1] not in OF_SCORES:
            calls = [n for n in ast.walk(_tree(path)) if isinstance(n, ast.Call)]
            found[name] += sum(keyword.arg == "valid" for call in calls for keyword in call.keywords)
    return +found


def takes_valid() -> set[str]:
    """The files of `onboard` in which a record loses its validity after it was made."""
    return {
        path.relative_to(ROOT).as_posix()
        for path in _files("onboard")
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == invalidate.__name__
    }


@cache
def functions() -> tuple[Function, ...]:
    """Every function of ours that ships or studies."""
    return tuple(_functions())


def _functions() -> Iterator[Function]:
    for path in _files(*OURS):
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                count = len(names) - (names[:1] in (["self"], ["cls"]))
                is_kernel = any(KERNELS in ast.unparse(d) for d in node.decorator_list)
                yield Function(f"{path.relative_to(ROOT)}:{node.name}", count, is_kernel, _is_typed(node))


def _is_typed(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    untyped = [a for a in given if a.annotation is None and a.arg not in ("self", "cls")]
    return node.returns is not None and not untyped


def lines_of_code(package: Path) -> int:
    """Lines that are neither empty, comments nor docstrings, in the files of a package."""
    return sum(_code(path) for path in package.rglob("*.py"))


def _code(path: Path) -> int:
    strings = (
        node.body[0]
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None
    )
    said = sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in strings)
    lines = (line.strip() for line in path.read_text(encoding="utf-8").splitlines())
    return sum(bool(line) and not line.startswith("#") for line in lines) - said


def names_of_two(package: Path) -> dict[str, list[str]]:
    """Classes of one name in several files of a package, and those files."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        for name in _classes(path):
            found[name].append(path.relative_to(package).as_posix())
    return {name: files for name, files in found.items() if len(files) > 1}


@cache
def _classes(path: Path) -> list[str]:
    return [node.name for node in ast.walk(_tree(path)) if isinstance(node, ast.ClassDef)]


def state_vectors(estimator: str) -> set[str]:
    """Return the modules with a state vector, of an estimator and of the models that it imports."""
    modules = [_module(path) for path in _files(f"onboard/estimators/{estimator}")]
    near = {m for m in needed_by(modules) if m in modules or m.startswith("onboard.models.")}
    return {m for m in near if COUNT_OF_STATES & _assigned(ROOT / f"{m.replace('.', '/')}.py")}


def numbers(estimator: str) -> int:
    """Count the chosen numbers of its modules, in constants and as defaults of records."""
    found = 0
    for path in _files(f"onboard/estimators/{estimator}"):
        tree = _tree(path)
        bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
        for node in (node for body in bodies for node in body):
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                constants = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
                found += sum(type(c) in (int, float) and c not in PLAIN for c in constants)
    return found


def _files(*folders: str) -> list[Path]:
    return [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _assigned(path: Path) -> set[str]:
    """The names that a module assigns itself."""
    if not path.exists():  # a package
        return set()
    body = _tree(path).body
    plain = [t for node in body if isinstance(node, ast.Assign) for t in node.targets]
    typed = [node.target for node in body if isinstance(node, ast.AnnAssign)]
    return {t.id for t in (*plain, *typed) if isinstance(t, ast.Name)}
