"""What is shown while something takes long."""

import os
import sys
from collections.abc import Callable, Iterable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from onboard.commands.compiling import Module, compile_all


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


def compile_shown(modules: Iterable[str] | None, console: Console, tell: Callable[[Module], None]) -> list[Module]:
    """Compile the modules of these names, or every one (None), and `tell` of each that has been made ready.

    Raises CompileError.
    """
    with progress_bar(console) as bar:
        task = bar.add_task("compiling what is not ready yet", total=None)

        def told(done: int, total: int, module: Module | None) -> None:
            bar.update(task, completed=done, total=total)
            if module is not None:
                tell(module)

        return compile_all(modules, told=told)


def announce_once(console: Console, what: str, how_long: str) -> Callable[[Module], None]:
    """A callback that prints, when the first module had to be compiled, that this takes a while."""
    compiled: list[Module] = []

    def on_module(module: Module) -> None:
        if module.compiled and not compiled:
            compiled.append(module)
            console.print(f"compiling what {what} needs ({how_long} on two cores, once)", highlight=False)

    return on_module
