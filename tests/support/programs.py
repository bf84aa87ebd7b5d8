"""Our programs as processes, started as a user starts them, on ports of their own."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

ROOT = Path(__file__).parents[2]
CODE = Path(os.environ.get("ONBOARD_CODE", ROOT))  # the checkout whose programs are started
DATA = ROOT.parent / "shared" / "data"
STATES = Path(tempfile.gettempdir()) / f"onboard-tests-{os.getpid()}"  # of daemons that are started again
NO_MORE: Mapping[str, str] = {}
TIMEOUT_S = 300.0  # a slower program hangs: no test here is about speed


def run(*command: str | Path, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Run `onboard ...` or `simlink ...` to its end."""
    return subprocess.run(
        argv(*command), cwd=cwd, capture_output=True, text=True, timeout=TIMEOUT_S, check=False, env=environment()
    )


def argv(*command: str | Path, python: Path = Path(sys.executable)) -> list[str]:
    module, *arguments = map(str, command)
    return [str(python), "-m", module, *arguments]


def environment() -> dict[str, str]:
    """Our environment, with the sources first on the path, without display and colours."""
    path = (str(CODE), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)))
    kept = {k: v for k, v in os.environ.items() if k not in {"DISPLAY", "WAYLAND_DISPLAY", "FORCE_COLOR"}}
    return {
        **kept,
        "PYTHONPATH": os.pathsep.join(path),
        "PYTHONUNBUFFERED": "1",
        "COLUMNS": "160",
        "NO_COLOR": "1",
        "PYTHONFAULTHANDLER": "1",
        "XDG_STATE_HOME": str(STATES),
    }


class Program:
    """A running program of ours, optionally of another Python; its stderr goes to the file `log`."""

    def __init__(
        self,
        log: Path,
        *command: str | Path,
        cwd: Path | None = None,
        python: Path = Path(sys.executable),
        env: Mapping[str, str] = NO_MORE,
    ) -> None:
        self.log = log
        self.stdout = log.with_suffix(".out")
        with log.open("wb") as err, self.stdout.open("wb") as out:
            # its own session: a signal to the group acts like Ctrl-C in a terminal
            self.popen = subprocess.Popen(
                argv(*command, python=python),
                stdout=out,
                stderr=err,
                cwd=cwd,
                env={**environment(), **env},
                start_new_session=True,
            )
        self.process = psutil.Process(self.popen.pid)
        self._family: set[psutil.Process] = set()

    def output(self) -> str:
        """Its stderr until now."""
        return self.log.read_text(errors="replace")

    def wait_for(self, text: str, count: int = 1) -> None:
        """Wait until `text` is in its output that many times; fails at once if it has ended."""
        until(
            lambda: self.output().count(text) >= count or self.popen.poll() is not None, f"{text!r} in {self.log}"
        )
        assert self.output().count(text) >= count, f"ended with {self.popen.poll()}, with output:\n{self.output()}"

    def descendants(self) -> list[psutil.Process]:
        found = list(self.process.children(recursive=True)) if self.popen.poll() is None else []
        self._family |= set(found)
        return found

    def kill(self) -> None:
        """Kill it and all processes that it is known to have started."""
        self.descendants()
        for process in (self.process, *self._family):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self.popen.wait(TIMEOUT_S)

    def end(self, number: int = signal.SIGTERM, *, group: bool = False) -> int:
        """Send a signal to it, or to its process group, and wait; its exit code."""
        if self.popen.poll() is None:
            (os.killpg if group else os.kill)(self.popen.pid, number)
        code = self.popen.wait(TIMEOUT_S)
        if code < 0 and code != -number:
            print(f"died of {signal.Signals(-code).name}, with output:\n{self.output()}", file=sys.stderr)
        return code


@contextmanager
def started(log: Path, *command: str | Path, cwd: Path | None = None) -> Iterator[Program]:
    """A Program, killed at the end with all its processes."""
    program = Program(log, *command, cwd=cwd)
    try:
        yield program
    finally:
        program.kill()


def until(condition: Callable[[], Any], what: str, timeout: float = TIMEOUT_S) -> Any:
    """Wait for `condition` to hold; its value."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout:g} s in vain for {what}")
        time.sleep(0.05)
    return value


def all_gone(processes: list[psutil.Process]) -> bool:
    return not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in processes)


def free_ports(*kinds: socket.SocketKind) -> list[int]:
    """Different ports on loopback that are free now."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, kind)) for kind in kinds]
        for s in sockets:
            s.bind(("127.0.0.1", 0))
        return [int(s.getsockname()[1]) for s in sockets]


def free_endpoint() -> str:
    """A Zenoh endpoint on a free port."""
    return f"tcp/127.0.0.1:{free_ports(socket.SOCK_STREAM)[0]}"
