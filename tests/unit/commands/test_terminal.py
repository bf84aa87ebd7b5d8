"""A terminal that closes, and a reader of the messages that goes away: neither costs a flight."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from onboard.terminal.output import Lines, end_signals, report
from tests.support.programs import ROOT, environment, started


@pytest.fixture
def handler() -> Iterator[None]:
    before = signal.getsignal(signal.SIGHUP)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("handler")
def test_a_closed_terminal_ends_a_program_unless_nohup_says_otherwise() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    assert set(end_signals()) == {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    assert set(end_signals()) == {signal.SIGINT, signal.SIGTERM}


def test_a_line_that_nobody_reads_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    reads, writes = os.pipe()
    os.close(reads)
    with open(writes, "w", buffering=1, encoding="utf-8", closefd=False) as broken:
        monkeypatch.setattr(sys, "stderr", broken)
        report("autopilot: heard again")
        monkeypatch.undo()
        os.dup2(os.open(os.devnull, os.O_WRONLY), writes)  # what is left in the buffer
    os.close(writes)


@pytest.mark.usefixtures("handler")
def test_a_daemon_whose_terminal_closes_ends_its_recording(tmp_path: Path) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # of the daemon too
    recording = tmp_path / "flight.mcap"
    sets = ("zenoh.enabled=false", "link=[{name='a', url='udpin:127.0.0.1:0'}]", f"recorder.path='{recording}'")
    with started(tmp_path / "log.txt", "onboard", "run", "--set", *sets) as daemon:
        daemon.wait_for("link a")
        assert daemon.end(signal.SIGHUP) == 0
    assert "stopped" in daemon.output()
    with recording.open("rb") as file:
        assert make_reader(file).get_summary() is not None  # it has its index


UNREAD = """
import os, sys
import onboard.daemon

class Daemon(onboard.daemon.Daemon):
    async def _fly(self, stop):
        self._report("flying")
        print("flying", flush=True)

reads, writes = os.pipe()
os.dup2(writes, 2)
os.close(reads), os.close(writes)
onboard.daemon.Daemon = Daemon
from onboard.commands.cli import main
sys.exit(main(["run", "--set", "zenoh.enabled=false", "link=[{name='a', url='udpin:127.0.0.1:0'}]"]))
"""


def test_a_daemon_whose_messages_nobody_reads_flies() -> None:
    """As `onboard run 2>&1 | head -1`."""
    done = subprocess.run(
        [sys.executable, "-c", UNREAD], cwd=ROOT, capture_output=True, text=True, check=False, env=environment()
    )
    assert (done.returncode, done.stdout) == (0, "flying\n")


def test_lines_that_nobody_reads_are_dropped_and_counted_and_hold_up_nothing() -> None:
    reading, writing = os.pipe()
    lines = Lines(writing)
    for n in range(2000):  # more than a pipe and the queue hold; none waits for the reader
        lines(f"{n} {'x' * 100}")
    lines.close()  # nor does the end
    found = b""
    while b"were dropped" not in found:
        lines("again")
        found += os.read(reading, 65536)
    numbers = [int(line.split()[0]) for line in found.splitlines() if line.endswith(b"x")]
    assert 200 < len(numbers) < 2000
    assert numbers == sorted(numbers)
    lines.close()
    os.close(reading)
    os.close(writing)


def test_lines_that_are_read_come_in_order_and_all() -> None:
    reading, writing = os.pipe()
    lines = Lines(writing)
    for n in range(100):
        lines(f"{n}")
    lines.close()
    assert os.read(reading, 65536).split() == [f"{n}".encode() for n in range(100)]
    os.close(reading)
    os.close(writing)


def test_lines_go_on_after_a_reader_that_could_not_take_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where standard error is a file on a disk that is full for a while."""
    written: list[bytes] = []

    def write(_: int, data: bytes) -> int:
        written.append(data)
        if len(written) == 1:
            raise OSError(28, "No space left on device")
        return len(data)

    monkeypatch.setattr(os, "write", write)
    lines = Lines(2)
    lines("first")
    lines("second")
    lines.close()
    assert written == [b"first\n", b"second\n"]
