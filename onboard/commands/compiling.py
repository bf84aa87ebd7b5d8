"""Compile kernels ahead, on all cores, so that the first flight does not wait for it. Machine code stays on disk.

A module with kernels is any module of `onboard` with a function under `@njit`. To import it compiles the
signatures it declares that are not on disk yet. One process imports it, once all modules with kernels that it
imports are ready, so nothing is compiled twice.

Numba compiles a function again when its own file changes, but not when a function that it calls stands in another
file and changes there. So machine code older than any source it may be made of is deleted here, and made anew.
"""

import ast
import importlib
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any, Final

from onboard import UserError
from onboard.analysis.parallel.processes import CONTEXT, processes
from onboard.commands import ready
from onboard.commands.ready import Module
from onboard.filters import numba_internals
from onboard.filters.shipped import Code

ROOT: Final = Path(__file__).parents[2]
KERNEL: Final = re.compile(r"^@njit", re.MULTILINE)
PROGRAMS: Final = (  # that fly, replay or show a flight
    "onboard.daemon",
    "onboard.commands.demo_flight",
    "onboard.commands.replay",
    "onboard.view.view",
)
EACH: Final = 1 << 30  # bytes that a process that compiles has at its most: 0.7 GB, and some
AVAILABLE: Final = re.compile(r"^MemAvailable: +(\d+) kB", re.MULTILINE)
FOLLOWED: Final = ("onboard.", "studies.")
FINDS_FILTERS: Final = "onboard.filters.methods"  # this function imports every module of its package


class CompileError(UserError):
    """The machine code cannot be made, or not be kept; the message says why."""


def compile_all(
    names: Iterable[str] | None = None,
    *,
    workers: int | None = None,
    into: Code | None = None,
    on_progress: Callable[[int, int, Module | None], None],
) -> list[Module]:
    """Make the kernels of these modules and of all that they may import ready, by default of all there are, in
    `workers` processes, by default one for each core. What is ready by a record is not loaded. After each
    module with kernels `on_progress(done, total, module)` is called; `module` is None if they are only compiled
    where others call them. The machine code is kept where Numba does, or `into` the folder that a wheel brings.

    Raises CompileError.
    """
    asked = ready.ALL if names is None else " ".join(sorted({*names}))
    folder = None if into is not None else cache_folder(ROOT / "onboard" / "__init__.py")
    record = ready.Ready("") if folder is None else ready.read(folder, _digest())
    is_new = asked not in record.asked
    if is_new:
        named = kernel_modules() if names is None else kernel_modules() & needed_by(asked.split())
        record.asked[asked] = sorted(named)
    wanted = {*record.asked[asked]}
    missing = {name for name in wanted if not record.has(name)}
    made = {name: record.modules[name].module for name in wanted - missing}
    for done, module in enumerate(made.values(), start=1):
        on_progress(done, len(wanted), module)
    if missing:
        for name, module in _compile(missing, workers, into):
            made[name] = module
            on_progress(len(made), len(wanted), module)
    if folder is not None and (missing or is_new):
        _keep(folder, record, made)
    return sorted(module for module in made.values() if module is not None)


def _compile(wanted: set[str], workers: int | None, into: Code | None) -> Iterator[tuple[str, Module | None]]:
    """Each of these modules, as soon as its kernels are ready."""
    needs = {name: needed_by([name], at_once=True) & wanted - {name} for name in wanted}
    rank = path_lengths(needs)
    order = TopologicalSorter(needs)
    order.prepare()
    drop_all_stale()
    count = (workers or _cores()) if numba_internals.can_lock_cache_files() else 1
    waiting: list[str] = []
    running: dict[Future[Module | None], str] = {}
    with _processes(count, into) as pool:
        while order.is_active():
            waiting = sorted([*waiting, *order.get_ready()], key=lambda name: (-rank[name], name))
            while waiting and len(running) < count:
                name = waiting.pop(0)
                running[pool.submit(_make_ready, name)] = name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                module = future.result()
                name = running.pop(future)
                order.done(name)
                yield name, module


def _digest() -> str:
    return ready.digest(ROOT / name.rstrip(".") for name in FOLLOWED)


def _keep(folder: Path, record: ready.Ready, made: Mapping[str, Module | None]) -> None:
    """Note what is ready, unless a source has changed meanwhile. Without a place for it, the next start looks
    again."""
    for name, module in made.items():
        record.keep(name, module, machine_code(name))
    if record.digest == _digest():
        with suppress(OSError):
            ready.write(folder, record)


def path_lengths(needs: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """For each module the lines of source on the longest path from it through modules that need it. Modules are
    compiled in this order, the longest first, so that the last ones are short."""
    lengths = {name: _source(name).read_text(encoding="utf-8").count("\n") for name in needs}
    longest: dict[str, int] = {}
    for name in reversed([*TopologicalSorter(needs).static_order()]):
        users = [longest[other] for other in longest if name in needs[other]]
        longest[name] = lengths[name] + max(users, default=0)
    return longest


# ------------------------------------------------------------------------------------------ which modules


@cache
def kernel_modules() -> frozenset[str]:
    """Every module of `onboard` with kernels."""
    return frozenset(n for n in _modules("onboard") if KERNEL.search(_source(n).read_text(encoding="utf-8")))


def flight_modules(estimators: Iterable[str]) -> list[str]:
    """The modules from which a flight with these modules of estimators begins, its replay and view included."""
    return [*PROGRAMS, *estimators]


def needed_by(names: Iterable[str], *, at_once: bool = False) -> set[str]:
    """These modules of `onboard` and every one that they may import; `at_once`, only by imports at the top
    level."""
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
    """The modules of `onboard` and of the studies that one of theirs names in imports: only at its top level, or
    anywhere."""
    tree = ast.parse(_source(name).read_text(encoding="utf-8"))
    named: set[str] = set()
    for node in tree.body if at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            named |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    if FINDS_FILTERS in named:
        named |= _modules(FINDS_FILTERS.rpartition(".")[0])
    return frozenset(n for n in named - {name} if n.startswith(FOLLOWED) and _source(n).exists())


def sources() -> dict[str, list[str]]:
    """For each module with kernels, by the path of its file, every file whose functions or constants may stand in
    its machine code. Paths are relative to the folder of the package."""
    paths = {name: _source(name).relative_to(ROOT).as_posix() for name in needed_by(kernel_modules())}
    return {paths[name]: sorted(paths[other] for other in needed_by([name])) for name in sorted(kernel_modules())}


# ------------------------------------------------------------------------------------- stale machine code


def drop_all_stale() -> None:
    """Delete machine code that is older than the module it is of, or than any that this one imports. Nothing is
    deleted if this Numba does not say where it is (`knows_folders`).

    Raises CompileError if there is no folder to write machine code to.
    """
    for name in kernel_modules():
        drop_stale(machine_code(name), max(_source(n).stat().st_mtime for n in needed_by([name])))


def machine_code(name: str) -> list[Path]:
    """The index and code files of a module's kernels; none if this Numba does not say where they are.

    Raises CompileError if there is no folder to write machine code to.
    """
    folder = cache_folder(_source(name))
    return [] if folder is None else [*folder.glob(f"{_source(name).stem}.*.nb[ic]")]


def drop_stale(code: Iterable[Path], newest: float) -> bool:
    """Delete files of machine code that are older than `newest` (s since the epoch); whether there were any."""
    stale = [path for path in code if path.stat().st_mtime < newest]
    for path in stale:
        path.unlink(missing_ok=True)
    return bool(stale)


def knows_folders() -> bool:
    """Whether this Numba says where it keeps machine code. Raises CompileError if it can keep none."""
    return cache_folder(_source(min(kernel_modules()))) is not None


def cache_folder(source: Path) -> Path | None:
    """The folder in which Numba keeps the machine code of a source; None if this Numba does not say.

    Raises CompileError if there is none that can be written to.
    """
    try:
        return numba_internals.cache_folder(source)
    except RuntimeError as error:
        places = f"{source.parent / '__pycache__'} nor the user's cache folder"
        raise CompileError(
            f"compile: neither {places} can be written to; set NUMBA_CACHE_DIR to one that can"
        ) from error


# ------------------------------------------------------------------------------------------ the processes


@contextmanager
def _processes(count: int, into: Code | None = None) -> Iterator[ProcessPoolExecutor]:
    """Processes that take turns to write machine code. Raises CompileError."""
    try:
        with processes(count, _begin, CONTEXT.Lock(), into) as pool:
            yield pool
    except BrokenProcessPool as error:
        raise CompileError("compile: a process was killed; is there too little memory?") from error
    except OSError as error:
        raise CompileError(f"compile: the machine code cannot be kept: {error}") from error


def _begin(lock: Any, into: Code | None) -> None:
    """Take turns, and leave it to the program that started this one to report."""
    if into is not None and not numba_internals.keep_code_in(into.place):
        raise CompileError("compile: this version of Numba keeps machine code in another way")
    numba_internals.lock_cache_files(lock)
    numba_internals.on_compile(lambda: None)


def _make_ready(name: str) -> Module | None:
    """Import a module; None if it declares no signatures, so that its kernels are in others' machine code."""
    start = time.perf_counter()
    module = importlib.import_module(name)
    functions = [f for f in vars(module).values() if _is_compiled(f) and f.py_func.__module__ == name]
    declared = [f for f in functions if f.nopython_signatures]
    if not declared:
        return None
    loaded = sum(sum(f.stats.cache_hits.values()) for f in declared)
    compiled = sum(sum(f.stats.cache_misses.values()) for f in declared)
    return Module(name, loaded, compiled, time.perf_counter() - start, declared[0].stats.cache_path)


def _is_compiled(value: Any) -> bool:
    return hasattr(value, "py_func") and hasattr(value, "nopython_signatures")


def _cores() -> int:
    """How many cores this process may use, where the system says so, and has memory for."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, _available() // EACH))


def _available(meminfo: Path = Path("/proc/meminfo")) -> int:
    """How many bytes of memory programs can have, where the system says so."""
    found = AVAILABLE.search(meminfo.read_text(encoding="utf-8")) if meminfo.exists() else None
    return 1 << 62 if found is None else 1024 * int(found[1])


def _modules(package: str) -> set[str]:
    folder = _folder(package)
    found = (path.relative_to(folder).with_suffix("").parts for path in folder.rglob("*.py"))
    return {".".join([package, *parts]) for parts in found if parts[-1] != "__init__"}


def _folder(package: str) -> Path:
    return ROOT.joinpath(*package.split("."))


def _source(name: str) -> Path:
    """The file of a module or package; it need not exist."""
    package = _folder(name) / "__init__.py"
    return package if package.exists() else _folder(name).with_suffix(".py")
