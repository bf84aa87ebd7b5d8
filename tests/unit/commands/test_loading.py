"""What a flight loads is out of the garbage collector's way; the session opens meanwhile, and a signal ends it."""

import ctypes
import gc
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

import pytest

from onboard import UserError
from onboard.commands import loading as loaded
from onboard.commands.cli import USER_ERROR, main
from onboard.commands.loading import HEAPS, NICE, loading
from onboard.config import parse_config
from onboard.daemon import Daemon
from tests.support.programs import TIMEOUT_S, environment


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """The collector and the signals, which `onboard run` sets, as they were."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    gc.enable()
    gc.unfreeze()
    for number, handler in handlers.items():
        signal.signal(number, handler)


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


def test_the_zenoh_session_opens_while_the_filters_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera that has lost its router is blind until it finds it again."""
    found: list[object] = []

    def daemon(*_: Any, session: Future[object], **__: Any) -> Any:
        found.append(session.result(TIMEOUT_S))
        raise UserError("that was all")

    monkeypatch.setattr("onboard.config.load_config", lambda *_: parse_config({}))
    monkeypatch.setattr("onboard.daemon.Daemon", daemon)
    monkeypatch.setattr("onboard.commands.run.go_first", lambda: None)
    monkeypatch.setattr("onboard.sinks.zenoh_session.open_session", lambda config: config)
    assert main(["run"]) == USER_ERROR
    assert found == [parse_config({}).zenoh]


LOADS = """
import os, signal, sys
from onboard.commands import {module}

signal.signal(signal.SIGHUP, signal.SIG_DFL)  # which nohup ignores

def load(*_):
    try:
        os.kill(os.getpid(), signal.Signals.{number})
        for _ in range(1000000): pass
    except BaseException as error:  # as a compiler's callback does
        print("swallowed", type(error).__name__, file=sys.stderr)
    raise RuntimeError("no compiled object yet")

{patch}
sys.argv = ["onboard", *{arguments}]
from onboard.__main__ import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("number", "module", "patch", "arguments"),
    [
        ("SIGINT", "run", "import onboard.config; onboard.config.load_config = load", ["run"]),
        ("SIGTERM", "router", "router.load_config = load", ["router", "x.toml"]),
        ("SIGTERM", "cli", "cli.parser = load", ["run"]),
        ("SIGHUP", "cli", "cli.parser = load", ["router", "x.toml"]),
    ],
)
def test_a_signal_while_it_loads_ends_it_well(number: str, module: str, patch: str, arguments: list[str]) -> None:
    code = LOADS.format(number=number, module=module, patch=patch, arguments=arguments)
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment(),
        timeout=TIMEOUT_S,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "stopped\n")
