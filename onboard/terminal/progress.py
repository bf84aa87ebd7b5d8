"""Progress on the terminal."""

import os
import sys

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from onboard.terminal.console import Console


def progress_bar(console: Console) -> Progress:
    """Return a bar that is shown on a terminal only."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        disable=not sys.stderr.isatty() or os.environ.get("TERM") == "dumb",
        transient=True,
    )
