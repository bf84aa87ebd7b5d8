"""Everything that is used of Numba's internals, which it neither documents nor promises to keep.

Each function says what its caller gets from a Numba that lacks the internal: slower code or less comfort, but
the same numbers. pyproject.toml bounds Numba's version, and tests/unit/filters/test_numba_internals.py tries
each internal with the version installed, and each fallback without it. Nothing of Numba is imported before a
function is called.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any


def without_reference_counts() -> dict[str, Any]:
    """The option of `njit` that switches the counting of references to arrays off; {} if Numba has none.

    With it the compiler refuses a function that creates an array.
    """
    try:
        from numba.core.options import DefaultOptions  # noqa: PLC0415 - an internal, which may be gone
    except ImportError:
        return {}
    return {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def load_without_scipy() -> bool:
    """Load Numba's array functions without SciPy's BLAS, which takes a fifth of a second and 20 MB that no flight
    needs. Kernels with a matrix product or a decomposition load it when they are first called. False, with nothing
    changed, if this Numba loads them in another way; all is then as without this call."""
    try:
        from numba.np import linalg  # noqa: PLC0415 - an internal, which may be gone
    except ImportError:
        return False
    found: Any = linalg
    ensure = getattr(found, "ensure_blas", None)
    if ensure is None:
        return False
    found.ensure_blas = _no_blas
    try:
        from numba.np import arraymath  # noqa: PLC0415, F401 - asks once, when it is loaded
    finally:
        found.ensure_blas = ensure
    return True


def _no_blas() -> None:
    raise ImportError("not loaded yet")


def lock_cache_files(lock: Any) -> bool:
    """Let this process read and write Numba's cache files only while it holds `lock` (a context manager), from now
    on. False, with nothing changed, if Numba's cache cannot be locked: then only one process may compile.

    A function inlined in several modules is compiled for each one's types. To save one, Numba reads the function's
    index, adds the next free number, and writes index and code. Two processes at once would take the same number,
    and one would find the other's code under its own types.
    """
    files = _cache_files()
    if files is None:
        return False
    for name in ("load", "save"):
        setattr(files, name, _locked(getattr(files, name), lock))
    return True


def can_lock_cache_files() -> bool:
    """Whether `lock_cache_files` works with this Numba."""
    return _cache_files() is not None


def cache_folder(source: Path) -> Path | None:
    """The folder in which Numba caches the machine code of functions in the file `source`; None if this Numba does
    not say.

    Raises RuntimeError if there is no folder that can be written to.
    """
    try:
        from numba.core.caching import FunctionCache  # noqa: PLC0415 - half a second, and an internal
    except ImportError:
        return None
    cache: Any = FunctionCache
    function = FunctionType((lambda: None).__code__.replace(co_filename=str(source)), {}, "function")
    folder = getattr(cache(function), "cache_path", None)
    return None if folder is None else Path(folder)


def on_compile(callback: Callable[[], None]) -> bool:
    """Call back before each function that Numba compiles in this process, not for those it loads from disk. False,
    with nothing changed, if this Numba does not tell.
    """
    try:
        from numba.core import event  # noqa: PLC0415 - half a second, and an internal
    except ImportError:
        return False

    class Listener(event.Listener):
        def on_start(self, _event: Any) -> None:
            callback()

        def on_end(self, _event: Any) -> None:
            pass

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]  # Numba has no types
    return True


def announce_compiling(package: str, line: str) -> bool:
    """Write a line on standard error before the first function of a package that Numba compiles in this process,
    unless something else is called back then (`on_compile`), and so reports it. False, with nothing changed, if
    this Numba does not tell.
    """
    try:
        from numba.core import event  # noqa: PLC0415 - an internal, which may be gone
    except ImportError:
        return False
    internal: Any = event
    kind = "numba:compile"

    class Announcement(event.Listener):
        done = False

        def on_start(self, happened: Any) -> None:
            if self.done or not _of_package(happened, package):
                return
            self.done = True
            if getattr(internal, "_registered", {}).get(kind, [self]) == [self]:
                print(line, file=sys.stderr, flush=True)

        def on_end(self, _event: Any) -> None:
            pass

    internal.register(kind, Announcement())
    return True


def _of_package(happened: Any, package: str) -> bool:
    """Whether an event is about a function of this package; not if this Numba does not say what it is about."""
    try:
        module: str = happened.data["dispatcher"].py_func.__module__
    except (AttributeError, KeyError, TypeError):
        return False
    return module.partition(".")[0] == package


def _cache_files() -> Any:
    """Numba's class that reads and writes the cache files of a function, or None."""
    try:
        from numba.core.caching import IndexDataCacheFile  # noqa: PLC0415 - half a second, and an internal
    except ImportError:
        return None
    files: Any = IndexDataCacheFile
    return files if hasattr(files, "load") and hasattr(files, "save") else None


def _locked(method: Callable[..., Any], lock: Any) -> Callable[..., Any]:
    def locked(*arguments: Any) -> Any:
        with lock:
            return method(*arguments)

    return locked
