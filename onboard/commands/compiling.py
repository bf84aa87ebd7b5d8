"""Compile kernels ahead, on all cores, so that the first flight does not wait for it. Machine code stays on disk.

Importing a module compiles what it declares and is not on disk. Each is imported by one process once all that it
imports itself is ready, so nothing is compiled twice.

Numba compiles a function again when its own file changes, but not when a function that it calls stands in another
file and changes there. So machine code older than any source with kernels is dropped here, and made anew.
"""

import ast
import importlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from types import FunctionType
from typing import Any, Final, NamedTuple

from onboard.errors import UserError

ROOT: Final = Path(__file__).parents[2]
# that have kernels
PACKAGES: Final = ("onboard.estimators", "onboard.filters", "onboard.geometry", "onboard.models")
KERNELS: Final = "onboard.filters.kernels"
# What takes longest, or is waited for by what does, goes first; measured. Of no matter but for the time it takes.
FIRST: Final = (
    *("onboard.filters.belief", f"{KERNELS}.sigma_points", f"{KERNELS}.gains", f"{KERNELS}.linear"),
    *(f"{KERNELS}.factors", f"{KERNELS}.linearisation", f"{KERNELS}.square_root"),
    *(f"{KERNELS}.variable_structure", f"{KERNELS}.unscented", f"{KERNELS}.mixture"),
    *("onboard.estimators.leader.modes", f"{KERNELS}.augmented"),
)
PROGRAMS: Final = (
    *("onboard.daemon", "onboard.commands.demo_flight"),
    *("onboard.commands.log_replay", "onboard.view.view"),
)
LOADS_ITS_PACKAGE: Final = "onboard.filters.methods"  # the function that imports every module beside it

Told = Callable[[int, int, "Module | None"], None]


class CompileError(UserError):
    """The machine code cannot be made, or not be kept; the message says why."""


class Module(NamedTuple):
    """What a module's kernels were: how many variants (of argument types) were loaded and compiled, in how many
    seconds, and where the machine code is kept."""

    name: str
    loaded: int
    compiled: int
    seconds: float
    folder: str


def compile_all(names: Iterable[str] | None = None, *, workers: int | None = None, told: Told) -> list[Module]:
    """Make the kernels of these modules ready, by default of all there are, in so many processes, by default one
    for each core. `told(done, total, module)` is called after each module that has kernels; `module` is None if
    they are only compiled where others call them.

    Raises CompileError.
    """
    wanted = {name for name in (all_modules() if names is None else names) if name.startswith(PACKAGES)}
    order = TopologicalSorter({name: imported_by(name, at_once=True) & wanted for name in wanted})
    order.prepare()
    drop_all_stale()
    count = workers or _cores()
    waiting: list[str] = []
    running: dict[Future[Module | None], str] = {}
    made: list[Module] = []
    done, total = 0, sum(map(_has_kernels, wanted))
    with _processes(count) as pool:
        while order.is_active():
            waiting = sorted({*waiting, *order.get_ready()}, key=_rank)
            while waiting and len(running) < count:
                name = waiting.pop(0)
                running[pool.submit(_make_ready, name)] = name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                name, module = running.pop(future), future.result()
                order.done(name)
                made += [module] if module is not None else []
                if _has_kernels(name):
                    done += 1
                    told(done, total, module)
    return sorted(made)


def all_modules() -> set[str]:
    """Every module of the packages in which there are kernels."""
    return {name for package in PACKAGES for name in _modules(package)}


def needed_by_flight(estimators: Iterable[str]) -> set[str]:
    """Every module of `onboard` that a flight with these modules of estimators may import, its replay and view
    included."""
    return needed_by([*PROGRAMS, *estimators])


def needed_by(names: Iterable[str]) -> set[str]:
    """These modules of `onboard` and every one that they may import."""
    found: set[str] = set()
    waiting = [*names]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += imported_by(name, at_once=False)
    return found


@cache
def imported_by(name: str, *, at_once: bool) -> frozenset[str]:
    """The modules of `onboard` that a module of it names in imports: only at its top level, or anywhere."""
    tree = ast.parse(_source(name).read_text(encoding="utf-8"))
    named: set[str] = set()
    for node in tree.body if at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            named |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    if LOADS_ITS_PACKAGE in named:
        named |= _modules(LOADS_ITS_PACKAGE.rpartition(".")[0])
    return frozenset(n for n in named - {name} if n.startswith("onboard.") and _source(n).exists())


def drop_all_stale() -> None:
    """Delete machine code that is older than any source with kernels. Raises CompileError if none can be kept."""
    newest = max(_source(name).stat().st_mtime for name in all_modules() if _has_kernels(name))
    for name in all_modules():
        if _has_kernels(name):
            drop_stale(kept_in(name), newest)


def drop_stale(folder: Path, newest: float) -> bool:
    """Delete those indices and files of machine code in `folder` that are older than the `newest` source (s since
    the epoch); whether there were any."""
    stale = [path for path in folder.glob("*.nb[ic]") if path.stat().st_mtime < newest]
    for path in stale:
        path.unlink(missing_ok=True)
    return bool(stale)


def kept_in(package: str) -> Path:
    """The folder in which Numba keeps the machine code of a package's modules.

    Raises CompileError if there is none that can be written to.
    """
    from numba.core.caching import FunctionCache  # noqa: PLC0415 - half a second

    keeper: Any = FunctionCache
    some = FunctionType((lambda: None).__code__.replace(co_filename=str(_source(package))), {}, package)
    try:
        return Path(keeper(some).cache_path)
    except RuntimeError as error:
        places = f"{_folder(package) / '__pycache__'} nor the user's cache folder"
        raise CompileError(
            f"compile: neither {places} can be written to; set NUMBA_CACHE_DIR to one that can"
        ) from error


# ------------------------------------------------------------------------------------------ the processes


@contextmanager
def _processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of them. All have ended after the block: at once if it does not end well."""
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(count, context, initializer=_begin, initargs=(context.Lock(),)) as pool:
        try:
            yield pool
        except BaseException as error:
            for process in set(multiprocessing.active_children()) - others:  # else they end their modules first
                process.terminate()
            if isinstance(error, BrokenProcessPool):
                raise CompileError("compile: a process was killed; is there too little memory?") from error
            if isinstance(error, OSError):
                raise CompileError(f"compile: the machine code cannot be kept: {error}") from error
            raise


def _begin(lock: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started us ends us
    one_at_a_time(lock)


def one_at_a_time(lock: Any) -> None:
    """Let this process read and write Numba's files only while it has the `lock`.

    A function inlined in several modules is compiled for each one's types. To save one, Numba reads the function's
    index, adds the next free number, and writes index and code: two processes at once would take the same number,
    and one would find the other's code under its own types.
    """
    from numba.core.caching import IndexDataCacheFile  # noqa: PLC0415 - half a second

    for name in ("load", "save"):
        setattr(IndexDataCacheFile, name, _locked(getattr(IndexDataCacheFile, name), lock))


def _locked(method: Callable[..., Any], lock: Any) -> Callable[..., Any]:
    def locked(*arguments: Any) -> Any:
        with lock:
            return method(*arguments)

    return locked


def _make_ready(name: str) -> Module | None:
    """Import a module; None if it declares no kernels."""
    start = time.perf_counter()
    module = importlib.import_module(name)
    functions = [f for f in vars(module).values() if _compiled(f) and f.py_func.__module__ == name]
    declared = [f for f in functions if f.nopython_signatures]  # else they stand in others' machine code
    if not declared:
        return None
    loaded = sum(sum(f.stats.cache_hits.values()) for f in declared)
    made = sum(sum(f.stats.cache_misses.values()) for f in declared)
    return Module(name, loaded, made, time.perf_counter() - start, declared[0].stats.cache_path)


def _compiled(value: Any) -> bool:
    return hasattr(value, "py_func") and hasattr(value, "nopython_signatures")


def _cores() -> int:
    """How many this process may use, where the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _rank(name: str) -> tuple[int, str]:
    return (FIRST.index(name) if name in FIRST else len(FIRST), name)


@cache
def _has_kernels(name: str) -> bool:
    return "njit" in _source(name).read_text(encoding="utf-8")


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
