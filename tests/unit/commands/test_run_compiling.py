"""`onboard run` says when it compiles: what a start waits for is on standard error."""

import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest
from numba import float64, njit
from numba.core import event

from onboard import UserError
from onboard.commands import compiling
from onboard.commands.cli import USER_ERROR, main
from onboard.commands.compiling import CompileError
from onboard.commands.run import PROGRESS_S, Compiling, compile_flight
from onboard.config import parse_config
from onboard.filters.numba_internals import on_compile
from tests.support.programs import TIMEOUT_S, environment

# all that the leader needs of the filters' kernels
SMALL = {"onboard.filters.kernels.cholesky", "onboard.filters.kernels.definite"}


@pytest.fixture(autouse=True)
def listeners() -> Any:
    """None of Numba's listeners but a test's own: one that another file's run left would compile what that one
    flies with. Then those and the signals, which `onboard run` sets, are as they were."""
    before = {kind: list(found) for kind, found in event._registered.items()}
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    event._registered.clear()
    yield
    event._registered.clear()
    event._registered.update(before)
    for number, handler in handlers.items():
        signal.signal(number, handler)


def compile_one() -> None:
    njit(float64(float64))(lambda x: x + 1.0)


def test_each_compiled_function_calls_back() -> None:
    calls: list[int] = []
    assert on_compile(lambda: calls.append(1))
    compile_one()
    assert len(calls) == 1


def test_a_function_that_is_loaded_from_disk_does_not(tmp_path: Path) -> None:
    source = tmp_path / "kernel.py"
    source.write_text("from numba import njit\n@njit('float64(float64)', cache=True)\ndef f(x): return 2.0 * x\n")
    calls: list[int] = []
    on_compile(lambda: calls.append(1))
    for name in ("first", "second"):
        spec = spec_from_file_location("kernel", source)
        assert spec is not None
        assert spec.loader is not None
        spec.loader.exec_module(module_from_spec(spec))
        assert len(calls) == 1, name


def test_a_start_that_compiles_has_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load_config(*_: Any) -> Any:
        compile_one()
        raise UserError("that was all")

    monkeypatch.setattr("onboard.config.load_config", load_config)
    assert main(["run"]) == USER_ERROR
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("compiling the filters")
    assert "`onboard compile`" in first
    assert second == "onboard: that was all"


def test_a_long_one_has_a_line_now_and_then() -> None:
    lines: list[str] = []
    now = 0.0
    compiling = Compiling(lines.append, lambda: now)
    for _ in range(100):
        compiling()
        now += 0.25 * PROGRESS_S
    assert len(lines) == 25
    assert lines[1] == f"still compiling: 4 functions in {PROGRESS_S:.0f} s"


def test_what_the_flight_needs_is_compiled_at_the_first_function_and_reported() -> None:
    lines: list[str] = []
    asked: list[int] = []
    now = 0.0

    def ahead(on_progress: Callable[[int, int], None]) -> None:
        nonlocal now
        asked.append(1)
        for done in range(1, 5):
            now += 0.6 * PROGRESS_S
            on_progress(done, 4)

    compiling = Compiling(lines.append, lambda: now)
    compiling.ahead = ahead
    for _ in range(3):
        compiling()
    assert len(asked) == 1
    assert lines[1:] == [
        f"still compiling: {done} of 4 parts in {0.6 * done * PROGRESS_S:.0f} s" for done in (2, 4)
    ]


def test_a_start_compiles_ahead_what_its_configuration_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    config, asked = parse_config({"zenoh": {"enabled": False}}), []

    def daemon(*_: Any, **__: Any) -> Any:
        compile_one()
        compile_one()
        raise UserError("that was all")

    monkeypatch.setattr("onboard.config.load_config", lambda *_: config)
    monkeypatch.setattr("onboard.daemon.Daemon", daemon)
    monkeypatch.setattr("onboard.commands.run.compile_flight", lambda one, _: asked.append(one))
    assert main(["run"]) == USER_ERROR
    assert asked == [config]


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


def test_where_it_cannot_be_compiled_ahead_it_is_compiled_one_by_one() -> None:
    lines: list[str] = []

    def ahead(_: Callable[[int, int], None]) -> None:
        raise CompileError("compile: a process was killed; is there too little memory?")

    compiling = Compiling(lines.append, lambda: 0.0)
    compiling.ahead = ahead
    compiling()
    assert lines[1] == "compile: a process was killed; is there too little memory?; going on with one core"


def test_a_flight_compiles_what_its_configuration_needs_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[set[str]] = []
    monkeypatch.setattr(compiling, "compile_all", lambda names, **_: asked.append(compiling.needed_by(names)))
    for estimator in ("leader", "own_state"):
        compile_flight(parse_config({"estimator": {estimator: {}}}), lambda *_: None)
    leader, own_state = asked
    assert "onboard.estimators.leader.hypotheses.view" in leader - own_state
    assert "onboard.filters.kernels.variable_structure" in own_state - leader
    assert not {n for n in leader if n.startswith("onboard.filters.kernels.")} - SMALL


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
