"""What a program that runs for hours tells a terminal, and what a terminal tells it. It may close at any time."""

import signal
import sys
from contextlib import suppress


def report(line: str) -> None:
    """A line for a person, on standard error. Nobody may read it any more: that ends no flight."""
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def end_signals() -> tuple[signal.Signals, ...]:
    """The signals that end a program: Ctrl-C's, SIGTERM, and a closed terminal's unless `nohup` ignores it."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *(() if ignored else (signal.SIGHUP,)))
