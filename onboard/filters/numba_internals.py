"""Everything that is used of Numba's internals, which it neither documents nor promises to keep.

Each function says what its caller gets from a Numba that lacks the internal: slower code or less comfort, but
the same numbers. pyproject.toml bounds Numba's version, and tests/unit/filters/test_numba_internals.py tries
each internal with the version installed, and each fallback without it. Nothing of Numba is imported before a
function is called.
"""

import io
import os
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import FunctionType
from typing import Any, Final, NamedTuple

MARK: Final = b"crc32"  # at the end of a cache file, before its checksum
CHECKSUM_SIZE: Final = 4


class CodeFolder(NamedTuple):
    """A folder with machine code of the functions of one source, and the stamp that it carries there: what stands
    under another stamp is of other sources."""

    folder: Path
    stamp: str


class Made(NamedTuple):
    """For which processor machine code is made: LLVM's name of it, and features beyond those that the name has, as
    "+crc,+lse"."""

    name: str
    features: str


Find = Callable[[Path], CodeFolder | None]  # where the code of a source is, if it is anywhere


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


def keep_cache_files_whole(line: str) -> bool:
    """Use no machine code of a file that a power cut left empty, half written or with holes: delete it, so that
    Numba compiles anew, and write a line on standard error, once. False, with nothing changed, if this Numba has
    other cache files: then such a file ends a program.

    Each file is on the disk before it gets its name, and ends with a checksum, which Numba does not read. That of
    code covers the time stamp of its source too: code of an older source may stand beside a new index. A file
    without a checksum is another program's; it is whole if it can be read.
    """
    files: Any = _cache_files()
    names = ("_load_index", "_load_data", "_open_for_write")
    if files is None or not all(hasattr(files, name) for name in names):
        return False
    from numba.core import caching  # noqa: PLC0415 - half a second, and an internal

    reports = iter([line])

    class Whole(files):  # type: ignore[misc]  # Numba has no types
        def _load_index(self) -> Any:
            try:
                return self._checked(self._index_path, super()._load_index)
            except OSError:
                return {}

        def _load_data(self, name: str) -> Any:
            return self._checked(self._data_path(name), partial(super()._load_data, name))

        @contextmanager
        def _open_for_write(self, path: str) -> Iterator[io.BytesIO]:
            with super()._open_for_write(path) as out:
                yield (content := io.BytesIO())
                data = content.getvalue()
                out.write(data + MARK + self._checksum(path, data))
                out.flush()
                os.fsync(out.fileno())

        def _checked(self, path: str, load: Callable[[], Any]) -> Any:
            """What a file holds. Raises OSError if there is none, or it was damaged and is deleted."""
            content, mark, checksum = Path(path).read_bytes().rpartition(MARK)
            has_none = not mark or len(checksum) != CHECKSUM_SIZE
            with suppress(Exception):  # of any kind: damaged data may lead the unpickling anywhere
                if has_none or checksum == self._checksum(path, content):
                    return load()
            for one in reports:
                print(f"{one} (the first is {path})", file=sys.stderr, flush=True)
            with suppress(OSError):
                Path(path).unlink()
            raise OSError(f"{path} is damaged")

        def _checksum(self, path: str, data: bytes) -> bytes:
            """Of a file's content, and of the stamp of the source that code was made of."""
            stamp = b"" if path == self._index_path else repr(self._source_stamp).encode()
            return zlib.crc32(data, zlib.crc32(stamp)).to_bytes(CHECKSUM_SIZE)

    setattr(caching, files.__name__, Whole)
    Whole.__name__ = files.__name__
    return True


def keep_cache_out_of_relative_folders() -> bool:
    """Keep no machine code in a folder named `~` where a program happens to be started, as Numba does for a user
    without a home (no `HOME`, and no entry among the users). There is no folder then, as where none is writable.
    False, with nothing changed, if this Numba finds a user's folder in another way."""
    try:
        from numba.core import caching  # noqa: PLC0415 - half a second, and an internal
    except ImportError:
        return False
    names = ("UserWideCacheLocator", "_UserWideCacheLocator")  # the second of Numba before 0.62
    locator: Any = next((getattr(caching, name) for name in names if hasattr(caching, name)), None)
    ensure = getattr(locator, "ensure_cache_path", None)
    if ensure is None or not hasattr(locator, "get_cache_path"):
        return False
    if ensure.__name__ == "ensure_absolute":
        return True

    def ensure_absolute(self: Any) -> None:
        if not Path(self.get_cache_path()).is_absolute():
            raise OSError(f"{self.get_cache_path()} is in no home")
        ensure(self)

    locator.ensure_cache_path = ensure_absolute
    return True


def look_first(find: Find, made: Made) -> bool:
    """Load machine code that was made for a processor from where `find` says, before Numba looks into its own
    cache. What is there needs no folder that can be written to: only if something has to be compiled RuntimeError
    says so. False, with nothing changed, if this Numba caches in another way."""
    if not _caches_as_known():
        return False
    from numba.core import caching, dispatcher  # noqa: PLC0415 - half a second, and internals

    user: Any = dispatcher
    internals: Any = caching

    class LooksFirst(user.FunctionCache):  # type: ignore[misc]  # Numba has no types
        def __init__(self, function: Any) -> None:
            super().__init__(function)
            place = find(Path(function.__code__.co_filename))
            self._first = None if place is None else _files_in(place, self._impl.filename_base)

        def _load_overload(self, signature: Any, context: Any) -> Any:
            if self._first is not None:
                types, (system, *_), code = self._index_key(signature, context.codegen())
                found = self._first.load((types, (system, *made), code))
                if found is not None:
                    return self._impl.rebuild(context, found)
            return super()._load_overload(signature, context)

    class ReadOnly(internals.InTreeCacheLocator):  # type: ignore[misc]  # Numba has no types
        @classmethod
        def from_function(cls, function: Any, source: str) -> Any:
            return None if find(Path(source)) is None else cls(function, source)

        def ensure_cache_path(self) -> None:
            raise RuntimeError(f"cannot cache function of {self._py_file}: no folder can be written to")

    user.FunctionCache = LooksFirst
    internals.CacheImpl._locator_classes = [*internals.CacheImpl._locator_classes, ReadOnly]  # noqa: SLF001
    return True


def keep_code_in(find: Find) -> bool:
    """Keep the machine code of the functions whose sources `find` knows there, and look for it nowhere else.
    Without the types that Numba found for each line, which are for people, and name the file. False, with nothing
    changed, if this Numba caches in another way."""
    if not _caches_as_known():
        return False
    from numba.core import caching  # noqa: PLC0415 - half a second, and an internal

    internals: Any = caching

    class Keeps(internals.InTreeCacheLocator):  # type: ignore[misc]  # Numba has no types
        @classmethod
        def from_function(cls, function: Any, source: str) -> Any:
            place = find(Path(source))
            return None if place is None else cls(function, source, place)

        def __init__(self, function: Any, source: str, place: CodeFolder) -> None:
            super().__init__(function, source)
            self._cache_path, self._place = str(place.folder), place

        def get_source_stamp(self) -> str:
            return self._place.stamp

    class Bare(internals.CompileResultCacheImpl):  # type: ignore[misc]  # Numba has no types
        def reduce(self, compiled: Any) -> Any:
            return tuple("" if isinstance(part, str) else part for part in super().reduce(compiled))

    internals.CacheImpl._locator_classes = [Keeps, *internals.CacheImpl._locator_classes]  # noqa: SLF001
    internals.FunctionCache._impl_class = Bare  # noqa: SLF001
    return True


def asked_for() -> tuple[str | None, str | None]:
    """The processor that Numba is set to compile for, by its name and features; None for what it finds."""
    from numba.core import config  # noqa: PLC0415 - half a second

    settings: Any = config
    return settings.CPU_NAME, settings.CPU_FEATURES


def processor_features() -> frozenset[str]:
    """What this processor can do, by LLVM's names; nothing if this Numba does not say."""
    try:
        from numba.core.codegen import get_host_cpu_features  # noqa: PLC0415 - half a second, and an internal
    except ImportError:
        return frozenset()
    flags: str = get_host_cpu_features()  # type: ignore[no-untyped-call]  # Numba has no types
    return frozenset(flag[1:] for flag in flags.split(",") if flag.startswith("+"))


def compiler_versions() -> dict[str, str]:
    """The versions that machine code depends on: Numba's, LLVM's ("?" if this Numba does not say) and Python's."""
    import numba  # noqa: PLC0415 - half a second
    from numba.core import codegen  # noqa: PLC0415 - an internal

    llvm = getattr(getattr(codegen, "ll", None), "llvm_version_info", "?")
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {"numba": numba.__version__, "llvm": ".".join(map(str, llvm)), "python": python}


def cache_folder(source: Path) -> Path | None:
    """The folder in which Numba caches the machine code of functions in the file `source`; None if this Numba does
    not say.

    Raises RuntimeError if there is no folder that can be written to.
    """
    try:
        from numba.core.caching import FunctionCache  # noqa: PLC0415 - half a second, and an internal
    except ImportError:
        return None
    keep_cache_out_of_relative_folders()
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


def _caches_as_known() -> bool:
    """Whether this Numba has what `look_first` and `keep_code_in` change."""
    try:
        from numba.core import caching, dispatcher  # noqa: PLC0415 - half a second, and internals
    except ImportError:
        return False
    known: tuple[tuple[Any, str], ...] = (
        (caching, "InTreeCacheLocator"),  # from 0.62 on; before, its name began with "_"
        (getattr(caching, "CacheImpl", None), "_locator_classes"),
        (getattr(caching, "CompileResultCacheImpl", None), "reduce"),
        (getattr(caching, "FunctionCache", None), "_impl_class"),
        (getattr(dispatcher, "FunctionCache", None), "_load_overload"),
        (getattr(dispatcher, "FunctionCache", None), "_index_key"),
    )
    return _cache_files() is not None and all(hasattr(owner, name) for owner, name in known)


def _files_in(place: CodeFolder, base: str) -> Any:
    """Numba's files of one function, in a place that is read only."""
    from numba.core import caching  # noqa: PLC0415 - an internal

    files: Any = caching.IndexDataCacheFile
    return files(str(place.folder), base, place.stamp)


def _locked(method: Callable[..., Any], lock: Any) -> Callable[..., Any]:
    def locked(*arguments: Any) -> Any:
        with lock:
            return method(*arguments)

    return locked
