"""Compile every kernel ahead, so that the first flight does not wait for it. What is compiled stays on disk.

Numba compiles a function again when its own file changes, but not when a function that it calls stands in another
file and changes there. So machine code older than any source with kernels is dropped here, and made anew.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import onboard.filters
import onboard.models

PACKAGES = (onboard.filters, onboard.models)


class Module(NamedTuple):
    """What a module's kernels were: how many variants (of argument types) were loaded and compiled, in how many
    seconds, and where the machine code is kept."""

    name: str
    loaded: int
    compiled: int
    seconds: float
    folder: str


def compile_all(clock: Callable[[], float]) -> Iterator[Module]:
    """Import every module that has kernels; they declare their types, so importing compiles what is not on disk.

    `clock` gives seconds. Yields each module once it is ready.
    """
    imported = []
    for package in PACKAGES:
        modules = pkgutil.iter_modules(package.__path__, f"{package.__name__}.")
        for found in sorted(
            modules, key=lambda m: "._kernels" not in m.name
        ):  # each timed before another imports it
            start = clock()
            module = importlib.import_module(found.name)
            functions = [f for f in vars(module).values() if _compiled(f) and f.py_func.__module__ == found.name]
            if functions:
                imported.append((module, functions, clock() - start))
    newest = max(Path(str(module.__file__)).stat().st_mtime for module, _, _ in imported)
    for module, functions, took in imported:
        start = clock()
        folder = Path(functions[0].stats.cache_path)
        declared = [f for f in functions if f.nopython_signatures]
        if drop_stale(folder, {_stem(f) for f in functions}, newest):
            for function in declared:
                function.recompile()
        loaded = sum(sum(f.stats.cache_hits.values()) for f in declared)
        made = sum(sum(f.stats.cache_misses.values()) for f in declared)
        if declared:  # else they stand in others' machine code
            yield Module(module.__name__, loaded, made, took + clock() - start, str(folder))


def drop_stale(folder: Path, stems: set[str], newest: float) -> bool:
    """Delete those indices of machine code in `folder` whose names begin with one of `stems` and that are older
    than the `newest` source (s since the epoch); whether there were any."""
    indices = [index for index in folder.glob("*.nbi") if index.name.split(".py3", 1)[0] in stems]
    stale = [index for index in indices if index.stat().st_mtime < newest]
    for index in stale:
        index.unlink()
    return bool(stale)


def _stem(function: Any) -> str:
    """What the names of a function's files begin with, as Numba makes them."""
    code = function.py_func.__code__
    return f"{Path(code.co_filename).stem}.{function.py_func.__qualname__}-{code.co_firstlineno}"


def _compiled(value: Any) -> bool:
    return hasattr(value, "py_func") and hasattr(value, "nopython_signatures")
