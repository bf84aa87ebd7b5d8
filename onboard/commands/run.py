"""`onboard run`: the daemon."""

import argparse
import asyncio
import sys

from onboard.commands.loading import loading


def main(arguments: argparse.Namespace) -> int:
    """Fly until SIGINT or SIGTERM. Raises UserError."""
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
