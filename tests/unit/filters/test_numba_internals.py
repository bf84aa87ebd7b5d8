"""Numba's internals that we rely on: each exists and does what its docstring states; we fly without it."""

import subprocess
import sys
import threading
import zlib
from collections.abc import Callable
from contextlib import suppress
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit, types
from numba.core import caching, options
from numba.core.caching import FunctionCache
from numba.core.errors import NumbaError
from numba.core.options import DefaultOptions
from numba.np import linalg

from onboard.filters import numba_internals
from onboard.filters.compiled import FILLING, MAKING
from tests.support.programs import ROOT, environment

VECTOR = types.Array(types.float64, 1, "C")
IndexDataCacheFile: Any = caching.IndexDataCacheFile.__mro__[-2]  # Numba's own
ONCE: dict[str, Any] = FILLING | {"cache": False}


@pytest.fixture(autouse=True)
def numbas_own_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caching, "IndexDataCacheFile", IndexDataCacheFile)


def making(a):  # type: ignore[no-untyped-def]
    b = np.empty(3)
    b[0] = a[0]
    a[1] = b[0]


def filling(a):  # type: ignore[no-untyped-def]
    tail = a[1:].reshape(-1, 2)
    for row in range(tail.shape[0]):
        tail[row, 0] = row
        tail[row, 1] = -row


def test_this_numba_has_them_all() -> None:
    assert numba_internals.without_reference_counts() == {"_nrt": False}
    assert numba_internals.can_lock_cache_files()
    assert numba_internals.cache_folder(Path(__file__)) is not None


def test_numba_loads_without_blas_and_finds_it_later(monkeypatch: pytest.MonkeyPatch) -> None:
    assert numba_internals.load_without_scipy()
    linalg.ensure_blas()  # as it was: else it raises
    product = njit(lambda a: np.dot(a, a))
    np.testing.assert_allclose(product(2.0 * np.eye(3)), 4.0 * np.eye(3))
    monkeypatch.delattr(linalg, "ensure_blas")
    assert not numba_internals.load_without_scipy()


def test_a_kernel_that_makes_an_array_is_refused() -> None:
    with pytest.raises(NumbaError, match="empty"):
        njit((VECTOR,), **ONCE)(making)


@pytest.mark.parametrize("options", [ONCE, MAKING | {"cache": False}], ids=["filling", "plain"])
def test_slices_of_what_is_filled_live_as_long_as_they_are_used(options: dict[str, Any]) -> None:
    kernel = njit((VECTOR,), **options)(filling)
    for _ in range(1000):
        a = np.empty(7)
        kernel(a)
        np.testing.assert_array_equal(a[1:], [0, 0, 1, -1, 2, -2])


def test_without_the_switch_kernels_are_compiled_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(DefaultOptions, "_nrt")
    assert numba_internals.without_reference_counts() == {}
    monkeypatch.delattr(options, "DefaultOptions")
    assert numba_internals.without_reference_counts() == {}


def test_two_that_save_code_of_one_function_do_not_mix_it_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("load", "save"):  # so that they are restored
        monkeypatch.setattr(IndexDataCacheFile, name, getattr(IndexDataCacheFile, name))
    load_index = IndexDataCacheFile._load_index
    both_have_read = threading.Barrier(2)

    def slowly(file: IndexDataCacheFile) -> dict[str, str]:
        found: dict[str, str] = load_index(file)
        with suppress(threading.BrokenBarrierError):
            both_have_read.wait(0.2)
        return found

    monkeypatch.setattr(IndexDataCacheFile, "_load_index", slowly)
    assert numba_internals.lock_cache_files(threading.Lock())
    file = IndexDataCacheFile(str(tmp_path), "f", "stamp")
    savers = [threading.Thread(target=file.save, args=(types, f"code for {types}")) for types in "ab"]
    for saver in savers:
        saver.start()
    for saver in savers:
        saver.join()
    assert [file.load(types) for types in "ab"] == ["code for a", "code for b"]


@pytest.mark.parametrize("name", ["load", "save"])
def test_a_cache_without_these_functions_is_not_locked(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    before = {other: getattr(IndexDataCacheFile, other) for other in {"load", "save"} - {name}}
    monkeypatch.delattr(IndexDataCacheFile, name)
    assert not numba_internals.can_lock_cache_files()
    assert not numba_internals.lock_cache_files(threading.Lock())
    assert before == {other: getattr(IndexDataCacheFile, other) for other in before}


def test_a_cache_without_files_is_not_locked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(caching, "IndexDataCacheFile")
    assert not numba_internals.can_lock_cache_files()
    assert not numba_internals.lock_cache_files(threading.Lock())


def test_a_cache_that_does_not_say_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FunctionCache, "cache_path", None)
    assert numba_internals.cache_folder(Path(__file__)) is None
    monkeypatch.delattr(caching, "FunctionCache")
    assert numba_internals.cache_folder(Path(__file__)) is None


@pytest.mark.parametrize("of_numba", [False, True])
def test_a_user_without_a_home_gets_no_folder_of_this_name(
    of_numba: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`onboard demo` compiled for minutes into a folder `~` where it was started. `of_numba`: before any kernel is
    loaded, as in `onboard compile`."""

    def no_entry(_: int) -> None:
        raise KeyError

    (tmp_path / "kernels.py").write_text("")
    (tmp_path / "__pycache__").write_text("")  # not writable, not even to root
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pwd.getpwuid", no_entry)
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert numba_internals.cache_folder(tmp_path / "kernels.py").is_relative_to(tmp_path / "home")
    monkeypatch.delenv("HOME")
    if of_numba:
        monkeypatch.setattr(
            caching.UserWideCacheLocator, "ensure_cache_path", caching._CacheLocator.ensure_cache_path
        )
    with pytest.raises(RuntimeError, match="cannot cache"):
        numba_internals.cache_folder(tmp_path / "kernels.py")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["__pycache__", "home", "kernels.py"]


def test_a_numba_without_a_user_s_folder_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(caching, "UserWideCacheLocator")
    assert not numba_internals.keep_cache_out_of_relative_folders()


def holed(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes(64) + data[middle + 64 :]


DAMAGED = {
    "empty": lambda data: data[:0],
    "half": lambda data: data[: len(data) // 2],
    "zeros": lambda data: bytes(len(data)),
    "holed": holed,
    "its end is zeros": lambda data: data[:-50] + bytes(50),
    "of an older source": lambda data: data[:-4] + zlib.crc32(data[:-9], zlib.crc32(b"(1, 2)")).to_bytes(4),
}


def load_kernel(source: Path) -> tuple[float, int]:
    """What the kernel of a module says, and how many of its signatures were compiled."""
    spec = spec_from_file_location("kernel", source)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.f(21.0), sum(module.f.stats.cache_misses.values())


def told(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What stands in the console but how long all compiling of this process has taken."""
    return [line for line in capsys.readouterr().err.splitlines() if not line.startswith("still compiling")]


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGED.values(), ids=DAMAGED)
def test_damaged_machine_code_is_dropped_and_compiled_anew(
    damage: Callable[[bytes], bytes],
    suffix: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert numba_internals.keep_cache_files_whole("damaged")
    source = tmp_path / "kernel.py"
    source.write_text("from numba import njit\n@njit('float64(float64)', cache=True)\ndef f(x): return 2.0 * x\n")
    assert [load_kernel(source) for _ in range(2)] == [(42.0, 1), (42.0, 0)]
    (file,) = tmp_path.rglob(f"*.{suffix}")
    file.write_bytes(damage(file.read_bytes()))
    assert not told(capsys)
    assert [load_kernel(source) for _ in range(2)] == [(42.0, 1), (42.0, 0)]
    assert told(capsys) == [f"damaged (the first is {file})"]


def test_a_changed_source_is_no_damage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert numba_internals.keep_cache_files_whole("damaged")
    first, second = (caching.IndexDataCacheFile(str(tmp_path), "f", stamp) for stamp in ("old", "new"))
    first.save("types", "code")
    assert (first.load("types"), second.load("types")) == ("code", None)
    assert not capsys.readouterr().err


@pytest.mark.parametrize("name", ["_load_index", "_load_data", "_open_for_write"])
def test_a_cache_that_writes_in_another_way_is_left_alone(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.delattr(IndexDataCacheFile, name)
    assert not numba_internals.keep_cache_files_whole("damaged")


COMPILES = """
import sys
from importlib import import_module
from onboard.filters.numba_internals import announce_compiling, on_compile

{first}
assert announce_compiling("kernel", "compiling, once")
sys.path.insert(0, {folder!r})
import_module({name!r})
"""
NOBODY, SOMEBODY = "", "on_compile(lambda: None)"


@pytest.mark.parametrize(
    ("name", "first", "times", "shown"),
    [
        ("kernel", NOBODY, 2, ["compiling, once\n", ""]),  # from disk the second time
        ("kernel", SOMEBODY, 1, [""]),  # who reports it
        ("my_own", NOBODY, 1, [""]),  # a user's model, compiled at each start
    ],
    ids=["first", "reported", "another's"],
)
def test_the_first_kernel_that_is_compiled_says_so(
    name: str, first: str, times: int, shown: list[str], tmp_path: Path
) -> None:
    """The first call of a filter waited 75 s in silence."""
    source = tmp_path / f"{name}.py"
    one = "@njit('float64(float64)', cache=True)\n"
    source.write_text(f"from numba import njit\n{one}def f(x): return 2 * x\n{one}def g(x): return 3 * x\n")
    code = COMPILES.format(first=first, name=name, folder=str(tmp_path))
    command, with_numba = [sys.executable, "-c", code], environment() | {"NUMBA_DISABLE_JIT": "0"}
    done = [
        subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT, env=with_numba)
        for _ in range(times)
    ]
    assert [one.stderr for one in done] == shown
