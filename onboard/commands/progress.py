"""Progress on the terminal: a bar, and the compilation of kernels shown on one."""

import os
import sys
from collections.abc import Callable, Iterable
from typing import Final

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from onboard.commands.compiling import Module, compile_all, knows_folders
from onboard.commands.console import Console

STALE: Final = (
    "this version of Numba does not say where it keeps machine code: after an edit of kernels, delete it yourself "
    "(*.nbi and *.nbc in the folders __pycache__)"
)


def progress_bar(console: Console) -> Progress:
    """A bar on a terminal, nothing elsewhere."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        disable=not sys.stderr.isatty() or os.environ.get("TERM") == "dumb",
        transient=True,
    )


def compile_shown(
    modules: Iterable[str] | None, console: Console, on_module: Callable[[Module], None]
) -> list[Module]:
    """Compile the modules of these names, or every one (None). `on_module` is called for each that has been made
    ready.

    Raises CompileError.
    """
    if not knows_folders():
        console.print(STALE, highlight=False)
    with progress_bar(console) as bar:
        task = bar.add_task("compiling what is not ready yet", total=None)

        def on_progress(done: int, total: int, module: Module | None) -> None:
            bar.update(task, completed=done, total=total)
            if module is not None:
                on_module(module)

        return compile_all(modules, on_progress=on_progress)


def announce_once(console: Console, what: str, how_long: str) -> Callable[[Module], None]:
    """A callback that prints, when the first module had to be compiled, that this takes a while."""
    compiled: list[Module] = []

    def on_module(module: Module) -> None:
        if module.compiled and not compiled:
            compiled.append(module)
            console.print(f"compiling what {what} needs ({how_long} on two cores, once)", highlight=False)

    return on_module
