"""`onboard run`: the daemon."""

import argparse
import asyncio
import sys
import time
from collections.abc import Callable
from typing import Final

from onboard.commands import terminal
from onboard.commands.loading import go_first, loading, release_compiler, share_heap
from onboard.filters.numba_internals import on_compile

PROGRESS_S: Final = 10.0  # between lines about compiling


def main(arguments: argparse.Namespace) -> int:
    """Fly until a signal, which may come while the daemon still loads. Raises UserError."""
    terminal.end_at_once()
    lines = _lines()
    report = lines or terminal.report
    try:
        return fly(arguments, report)
    finally:
        if lines is not None:
            lines.close()


def _lines() -> terminal.Lines | None:
    """What writes lines without waiting for their reader; None where standard error is no file of the system's."""
    try:
        return terminal.Lines(sys.stderr.fileno())
    except (AttributeError, OSError):
        return None


def fly(arguments: argparse.Namespace, report: Callable[[str], None]) -> int:
    """Load, and run the daemon to its end."""
    on_compile(Compiling(report))
    share_heap()
    with loading():
        from onboard.config import load_config  # noqa: PLC0415 - the block is about loading
        from onboard.daemon import Daemon  # noqa: PLC0415

        config = load_config(arguments.config, tuple(arguments.set))
        daemon = Daemon(config, report=report)
    release_compiler()
    go_first()
    asyncio.run(daemon.run(terminal.end_signals()))
    return 0


class Compiling:
    """Lines about the filters that are compiled, which takes minutes, once on each computer: no start waits for it
    silently. Call it before each function."""

    def __init__(self, report: Callable[[str], None], monotonic: Callable[[], float] = time.monotonic) -> None:
        self._report, self._monotonic = report, monotonic
        self._count = 0
        self._began = self._shown = 0.0

    def __call__(self) -> None:
        """One more function."""
        now = self._monotonic()
        if not self._count:
            self._began = self._shown = now
            self._report("compiling the filters for this computer: minutes, once (ahead: `onboard compile`)")
        elif now - self._shown >= PROGRESS_S:
            self._shown = now
            self._report(f"still compiling: {self._count} functions in {now - self._began:.0f} s")
        self._count += 1
