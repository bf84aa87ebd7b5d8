"""`onboard run`: the daemon."""

import argparse
import asyncio
import signal
import sys

from onboard.commands.loading import loading


def main(arguments: argparse.Namespace) -> int:
    """Fly until SIGINT or SIGTERM, which may come while the daemon still loads. Raises UserError."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return fly(arguments)
    except KeyboardInterrupt:
        report("stopped")
        return 0


def fly(arguments: argparse.Namespace) -> int:
    """Load, and run the daemon to its end."""
    with loading():
        from onboard.config import load_config  # noqa: PLC0415 - the block is about loading
        from onboard.daemon import Daemon  # noqa: PLC0415

        config = load_config(arguments.config, tuple(arguments.set))
        daemon = Daemon(config, report=report)
    asyncio.run(daemon.run())
    return 0


def report(line: str) -> None:
    """A line for a person, on standard error."""
    print(line, file=sys.stderr, flush=True)
