"""What a program that runs for hours tells a terminal, and what a terminal tells it. It may close at any time."""

import os
import queue
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import Final, NoReturn

MOST_WAITING_LINES: Final = 256  # that wait for a reader
SHORT: Final = 200  # letters
LAST_S: Final = 1.0  # for the last lines of a program whose lines nobody may read


def report(line: str) -> None:
    """A line for a person, on standard error. Nobody may read it any more: that ends no flight."""
    with suppress(OSError):
        print(one_line(line), file=sys.stderr, flush=True)


def show(line: str) -> None:
    """A line of a result, on standard output."""
    print(one_line(line), flush=True)


def one_line(text: str) -> str:
    """Text, parts of which may come from outside, as a line that controls no terminal."""
    if text.isprintable() and len(text) < SHORT:
        return text
    from onboard.messages.text import MAX_LINE_LENGTH, plain  # noqa: PLC0415 - this file is loaded before all others

    return plain(text, MAX_LINE_LENGTH)


class Lines:
    """Lines for a person, on standard error, whose reader may have stopped reading: a terminal after Ctrl-S, a
    frozen remote session, a stuck log. A thread writes them; what it has no room for is dropped and counted."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: queue.Queue[str | None] = queue.Queue(MOST_WAITING_LINES)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write, daemon=True, name="lines")
        self._thread.start()

    def __call__(self, line: str) -> None:
        """Queue a line. Never blocks."""
        try:
            self._waiting.put_nowait(line)
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Wait for what is still queued, but not for a reader that does not read."""
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        self._thread.join(LAST_S)

    def _write(self) -> None:
        while (line := self._waiting.get()) is not None:
            dropped, self._dropped = self._dropped, 0
            missing = f"({dropped} lines were dropped: nobody read them)\n" if dropped else ""
            data = f"{missing}{one_line(line)}\n".encode(errors="backslashreplace")
            with suppress(OSError):  # nobody may read it any more: that ends no flight
                while data:
                    data = data[os.write(self._descriptor, data) :]


def end_signals() -> tuple[signal.Signals, ...]:
    """The signals that end a program: Ctrl-C's, SIGTERM, and a closed terminal's unless `nohup` ignores it."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *(() if ignored else (signal.SIGHUP,)))


def end_at_once() -> None:
    """Let these signals end the program while it loads, with exit code 0: there is nothing to close yet. An
    exception would not do: compilers and callbacks from C swallow it, or fail of it with another."""
    for number in end_signals():
        signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - the signature of handlers
    with suppress(AttributeError, OSError):  # standard error may be closed
        last = Lines(sys.stderr.fileno())
        last("stopped")
        last.close()
    os._exit(0)
