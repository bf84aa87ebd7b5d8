"""`onboard run`: the daemon."""

import argparse
import asyncio
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from onboard.commands.loading import go_first, loading, share_heap
from onboard.terminal import output as terminal

if TYPE_CHECKING:
    from onboard.sinks.zenoh_session import ZenohConfig, ZenohSession


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
    """Return a writer of lines that never waits for their reader, or None if standard error is no file."""
    try:
        return terminal.Lines(sys.stderr.fileno())
    except (AttributeError, OSError):
        return None


def fly(arguments: argparse.Namespace, report: Callable[[str], None]) -> int:
    """Load, and run the daemon to its end."""
    share_heap()
    with loading():
        from onboard.config import load_config  # noqa: PLC0415 - the block is about loading

        config = load_config(arguments.config, tuple(arguments.set))
        # cameras find the router again while the filters load
        session = ThreadPoolExecutor(1).submit(open_first, config.zenoh) if config.zenoh.enabled else None
        from onboard.daemon import Daemon  # noqa: PLC0415 - loads the filters

        daemon = Daemon(config, report=report, session=session)
    go_first()
    asyncio.run(daemon.run(terminal.end_signals()))
    return 0


def open_first(config: "ZenohConfig") -> "ZenohSession":
    """Open the Zenoh session, whose threads go first, too. Raises SinkError."""
    from onboard.sinks.zenoh_session import open_session  # noqa: PLC0415 - the block is about loading

    go_first()
    return open_session(config)
