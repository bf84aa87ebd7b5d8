"""Programs of ours that run beside the demo, and interruptions that end them all."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Final, NamedTuple

from onboard import UserError
from onboard.messages import Cause
from onboard.sinks.zenoh_session import RouterAbsentError
from onboard.terminal.output import end_signals
from onboard.view.client import Client

STOP_TIMEOUT_S: Final = 5.0
CONNECT_RETRY_PERIOD_S: Final = 0.1


class DemoError(UserError):
    """The demo could not run to its end; the message says which part failed, and its last words."""


@contextlib.contextmanager
def interruptions() -> Iterator[Callable[[], None]]:
    """A function that raises KeyboardInterrupt if the user has wanted an end. The handler raises it too, but what
    is raised while an object is finalised, say, is only printed, and the demo would end as if it had flown."""
    came: list[int] = []

    def note(number: int, _: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    def heed() -> None:
        if came:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, note) for number in end_signals()}
    try:
        yield heed
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Process(NamedTuple):
    """A program of ours that runs beside this one, and where it writes."""

    name: str
    popen: "subprocess.Popen[bytes]"
    log: Path

    def check(self) -> bool:
        """Whether it still runs. Raises DemoError if it has ended with an error."""
        code = self.popen.poll()
        if code not in {None, 0}:
            words = self.log.read_text(errors="replace").strip().splitlines()
            raise DemoError(f"{self.name} ended with code {code}: {words[-1] if words else 'no output'}")
        return code is None


@contextlib.contextmanager
def process(command: list[str], log: Path) -> Iterator[Process]:
    """Run one of our commands until the block ends; then ask it to stop, and see that it does."""
    with log.open("wb") as out:
        popen = _start(command, out)
        try:
            yield Process(command[0], popen, log)
        finally:
            if popen.poll() is None:
                popen.send_signal(signal.SIGTERM)
            try:
                popen.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                popen.kill()
                popen.wait()


def _start(command: list[str], out: IO[bytes]) -> "subprocess.Popen[bytes]":
    program, *arguments = command
    how = [program] if program.endswith(".py") else ["-m", program]
    return subprocess.Popen(  # noqa: S603 - our own program, or the user's, with arguments made above
        [sys.executable, *how, *arguments],
        stdout=out,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        env=dict(os.environ, PYTHONUNBUFFERED="1"),
    )


def connect(endpoint: str, vehicle: str, daemon: Process, on_wait: Callable[[float], None]) -> Client:
    """A client of the daemon, once it publishes. On a busy computer that takes long, so this waits for as long as
    the daemon runs. `on_wait` is called every `CONNECT_RETRY_PERIOD_S` with the seconds so far.

    Raises DemoError if the daemon ends first, and SinkError where no waiting helps.
    """
    begin = time.monotonic()
    client: Client | None = None
    with contextlib.ExitStack() as stack:
        while client is None or not client.alive.wait(CONNECT_RETRY_PERIOD_S):
            if not daemon.check():
                raise DemoError("the daemon ended with code 0 before it was up")
            on_wait(time.monotonic() - begin)
            if client is None:
                client = _client(endpoint, vehicle)
                stack.callback(client.close) if client is not None else time.sleep(CONNECT_RETRY_PERIOD_S)
        stack.pop_all()
    return client


def _client(endpoint: str, vehicle: str) -> Client | None:
    """None if no router answers yet."""
    try:
        return Client(endpoint, vehicle)
    except RouterAbsentError as error:
        if error.cause is Cause.TLS:
            raise
        return None


def free_ports() -> tuple[int, int, int]:
    """Two UDP ports and a TCP port on loopback that are free now."""
    with contextlib.ExitStack() as stack:
        kinds = (socket.SOCK_DGRAM, socket.SOCK_DGRAM, socket.SOCK_STREAM)
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, kind)) for kind in kinds]
        for s in sockets:
            s.bind(("127.0.0.1", 0))
        a, b, c = (s.getsockname()[1] for s in sockets)
        return a, b, c
