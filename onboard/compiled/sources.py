"""Which modules have kernels, and which sources their machine code depends on."""

import ast
import hashlib
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Final

from onboard.compiled.machine import ROOT

KERNEL: Final = re.compile(r"^@kernel\(", re.MULTILINE)


@cache
def kernel_modules() -> tuple[str, ...]:
    """Every module of `onboard` with kernels."""
    paths = sorted((ROOT / "onboard").rglob("*.py"))
    return tuple(name_of(path) for path in paths if KERNEL.search(path.read_text(encoding="utf-8")))


def sources(modules: Iterable[str]) -> list[str]:
    """The files, below the root, that these modules' machine code depends on.

    They are the modules and all of `onboard` that they import at once, except those that load machine code.
    """
    needed = needed_by(modules, at_once=True) - {"onboard.compiled", "onboard.compiled.machine"}
    return sorted(path_of(name).relative_to(ROOT).as_posix() for name in needed)


def code_digest(files: Iterable[str]) -> str:
    """SHA-256 over the code of files below the root, without comments and docstrings."""
    return hashlib.sha256("".join(map(_code, files)).encode()).hexdigest()


@cache
def _code(file: str) -> str:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [part for part in node.body if not _is_text(part)]
    return f"{file} {ast.dump(tree)}"


def _is_text(part: ast.stmt) -> bool:
    return isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant)


def needed_by(names: Iterable[str], *, at_once: bool = False) -> set[str]:
    """These modules of `onboard` and their imports; `at_once`, only those at the top level."""
    found: set[str] = set()
    waiting = [*names]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += imported_by(name, at_once=at_once)
    return found


@cache
def imported_by(name: str, *, at_once: bool) -> frozenset[str]:
    """The modules of `onboard` that one names in imports: only at its top level, or anywhere."""
    tree = ast.parse(path_of(name).read_text(encoding="utf-8"))
    named: set[str] = set()
    for node in tree.body if at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            named |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(n for n in named - {name} if n.startswith("onboard.") and path_of(n).exists())


def path_of(name: str) -> Path:
    """The file of a module, or of a package."""
    path = ROOT / name.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def name_of(path: Path) -> str:
    """The module of a file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)
