"""What is shown while something takes long."""

import os
import sys
from collections.abc import Callable, Iterable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from onboard.compiling import Module, compile_all, needed_by


def progress_bar(console: Console) -> Progress:
    """A bar where somebody watches, silence where not."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        disable=not sys.stderr.isatty() or os.environ.get("TERM") == "dumb",
        transient=True,
    )


def compile_shown(
    estimators: Iterable[str] | None, console: Console, tell: Callable[[Module], None]
) -> list[Module]:
    """Compile what a flight with estimators of these names needs, or everything (None), and `tell` of each module
    that has been made ready. Raises CompileError."""
    with progress_bar(console) as bar:
        task = bar.add_task("compiling what is not ready yet", total=None)

        def told(done: int, total: int, module: Module | None) -> None:
            bar.update(task, completed=done, total=total)
            if module is not None:
                tell(module)

        return compile_all(None if estimators is None else needed_by(estimators), told=told)
