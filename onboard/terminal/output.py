"""Lines from a long-running program to a terminal, and the signals that end it.

The terminal may close at any time.
"""

import os
import queue
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import Final, NoReturn

MAX_QUEUE_LENGTH: Final = 256  # lines
MAX_PLAIN_LENGTH: Final = 200  # characters
CLOSE_TIMEOUT_S: Final = 1.0  # for the last lines, whose reader may have stopped reading


def report(line: str) -> None:
    """Print a line for a person on standard error; a closed terminal must not end the flight."""
    with suppress(OSError):
        print(one_line(line), file=sys.stderr, flush=True)


def show(line: str) -> None:
    """Print a line of a result on standard output."""
    print(one_line(line), flush=True)


def one_line(text: str) -> str:
    """Return untrusted text as one line without control characters."""
    if text.isprintable() and len(text) < MAX_PLAIN_LENGTH:
        return text
    from onboard.messages.text import MAX_LINE_LENGTH, plain  # noqa: PLC0415 - this file is loaded before all others

    return plain(text, MAX_LINE_LENGTH)


class Lines:
    """Lines for a person on standard error, written by a thread.

    Their reader may have stopped reading: a terminal after Ctrl-S, a frozen remote session, a stuck log. Lines
    without room in the queue are dropped and counted.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: queue.Queue[str | None] = queue.Queue(MAX_QUEUE_LENGTH)
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
        """Wait for queued lines, but not for a reader that does not read."""
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        self._thread.join(CLOSE_TIMEOUT_S)

    def _write(self) -> None:
        while (line := self._waiting.get()) is not None:
            dropped, self._dropped = self._dropped, 0
            missing = f"({dropped} lines were dropped, since nobody read them)\n" if dropped else ""
            data = f"{missing}{one_line(line)}\n".encode(errors="backslashreplace")
            with suppress(OSError):  # nobody may read it any more: that ends no flight
                while data:
                    data = data[os.write(self._descriptor, data) :]


def end_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that end a program: SIGINT, SIGTERM, SIGHUP (unless ignored)."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *(() if ignored else (signal.SIGHUP,)))


def end_at_once() -> None:
    """Let these signals end the program with exit code 0 while it loads.

    An exception would not do: compilers and callbacks from C swallow it, or fail with another one.
    """
    for number in end_signals():
        signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - the signature of handlers
    with suppress(AttributeError, OSError):  # standard error may be closed
        last = Lines(sys.stderr.fileno())
        last("stopped")
        last.close()
    os._exit(0)
