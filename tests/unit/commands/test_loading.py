"""What a flight loads is out of the garbage collector's way, from the start, and the compiler out of memory."""

import ctypes
import gc
import mmap
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numba
import pytest

from onboard.commands import loading as loaded
from onboard.commands.cli import main
from onboard.commands.loading import HEAPS, NICE, loading, release_compiler
from onboard.daemon import Daemon


@pytest.fixture(autouse=True)
def collector() -> Iterator[None]:
    """The collector as it was."""
    yield
    gc.enable()
    gc.unfreeze()


def test_the_collector_rests_while_modules_load_and_leaves_them_alone_afterwards() -> None:
    gc.unfreeze()
    with loading():
        assert not gc.isenabled()
        made = [[] for _ in range(1000)]
    assert gc.isenabled()
    assert gc.get_freeze_count() > len(made)


def test_one_that_was_off_stays_off() -> None:
    gc.disable()
    with loading():
        pass
    assert not gc.isenabled()


def test_it_works_again_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), loading():
        _ = 1 / 0
    assert gc.isenabled()


SMAPS = Path("/proc/self/smaps")


def resident() -> int:
    """kB of LLVM's library that this process has in memory."""
    parts = re.findall(r"/libllvmlite\b.*\n(?:\w+:.*\n)*?Rss: +(\d+) kB", SMAPS.read_text(encoding="utf-8"))
    return sum(map(int, parts))


@pytest.mark.skipif(not SMAPS.exists(), reason="no /proc/self/smaps on this system")
def test_the_compilers_memory_is_given_back_and_it_still_compiles() -> None:
    assert numba.njit(lambda x: x + 1)(1) == 2
    before = resident()
    assert release_compiler() > 0
    assert resident() < before / 4
    assert numba.njit(lambda x: x + 2)(1) == 3


def test_pages_that_the_process_has_changed_are_not_given_back(tmp_path: Path) -> None:
    page = mmap.mmap(-1, mmap.PAGESIZE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    page[:4] = b"ours"
    begin = ctypes.addressof(ctypes.c_char.from_buffer(page))
    mapped = f"{begin:x}-{begin + len(page):x} r--p 00000000 08:01 1 /x/libllvmlite.so\nSize: 4 kB\n"
    smaps = tmp_path / "smaps"
    smaps.write_text(mapped + "Anonymous: 4 kB\nVmFlags: rd\n", encoding="utf-8")
    assert release_compiler(smaps) == 0
    assert page[:4] == b"ours"
    smaps.write_text(mapped.replace("r--p", "rw-p") + "Anonymous: 0 kB\n", encoding="utf-8")
    assert release_compiler(smaps) == 0


def test_a_system_without_such_a_list_keeps_them(tmp_path: Path) -> None:
    assert release_compiler(tmp_path / "none") == 0


def test_a_flight_begins_with_all_that_is_loaded_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    gc.unfreeze()
    seen: list[tuple[bool, int]] = []

    asked: list[int] = []

    async def run(self: Daemon, end_signals: object) -> None:
        del self, end_signals
        seen.append((gc.isenabled(), gc.get_freeze_count()))

    monkeypatch.setattr(Daemon, "run", run)
    monkeypatch.setattr(os, "getpriority", lambda *_: 0)
    monkeypatch.setattr(os, "setpriority", lambda *asks: asked.append(asks[-1]))  # not that of the tests
    assert main(["run", "--set", "zenoh.enabled=false"]) == 0
    ((enabled, frozen),) = seen
    assert enabled
    assert frozen > 10_000
    assert asked == [NICE]


def alone(code: str) -> str:
    """What a process of its own prints."""
    command = [sys.executable, "-c", f"from onboard.commands import loading\n{code}"]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.strip()


@pytest.mark.parametrize(("chosen", "taken"), [(0, [NICE]), (5, []), (-20, [])])
def test_it_goes_before_others_unless_somebody_chose_a_priority(
    chosen: int, taken: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(os, "getpriority", lambda *_: chosen)
    monkeypatch.setattr(os, "setpriority", lambda *asks: asked.append(asks[-1]))
    loaded.go_first()
    assert asked == taken


def test_a_refused_priority_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "getpriority", lambda *_: 0)
    monkeypatch.setattr(os, "setpriority", refuse)
    loaded.go_first()


COUNT_HEAPS = """
import ctypes, threading
libc = ctypes.CDLL(None)
libc.malloc.restype = libc.fopen.restype = ctypes.c_void_p
{first}
done = threading.Barrier(9)
def take():
    libc.malloc(1000)
    done.wait()
for _ in range(8):
    threading.Thread(target=take).start()
done.wait()
libc.fopen.argtypes, libc.fclose.argtypes = (ctypes.c_char_p, ctypes.c_char_p), (ctypes.c_void_p,)
libc.malloc_info.argtypes = ctypes.c_int, ctypes.c_void_p
file = libc.fopen(b"/dev/stdout", b"w")
libc.malloc_info(0, file)
libc.fclose(file)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_info"), reason="not the GNU C library")
def test_threads_share_heap() -> None:
    assert alone(COUNT_HEAPS.format(first="")).count("<heap nr=") > HEAPS
    assert alone(COUNT_HEAPS.format(first="loading.share_heap()")).count("<heap nr=") <= HEAPS


def test_a_c_library_without_heaps_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda _: object())
    loaded.share_heap()
