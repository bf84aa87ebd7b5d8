"""What a flight loads is out of the garbage collector's way, from the start, and the compiler out of memory."""

import ctypes
import gc
import mmap
import re
from collections.abc import Iterator
from pathlib import Path

import numba
import pytest

from onboard.commands.cli import main
from onboard.commands.loading import loading, release_compiler
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
        made = [[] for _ in range(1000)]  # type: ignore[var-annotated]  # of anything
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

    async def run(self: Daemon) -> None:
        del self
        seen.append((gc.isenabled(), gc.get_freeze_count()))

    monkeypatch.setattr(Daemon, "run", run)
    assert main(["run"]) == 0
    ((enabled, frozen),) = seen
    assert enabled
    assert frozen > 10_000
