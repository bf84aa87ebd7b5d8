"""`onboard compile`: the filters' machine code, before the first flight."""

import argparse
import os
import time
from collections.abc import Callable, Iterable
from typing import Final

from onboard.commands.compiling import compile_all, flight_modules, knows_folders
from onboard.commands.ready import Module
from onboard.config import estimator_modules, load_config
from onboard.terminal.console import Console
from onboard.terminal.progress import progress_bar

STALE: Final = (
    "this version of Numba does not say where it keeps machine code: after an edit of kernels, delete it yourself "
    "(*.nbi and *.nbc in the folders __pycache__)"
)


def main(arguments: argparse.Namespace) -> int:
    """Compile everything, or what a configuration flies with. Raises UserError."""
    start = time.perf_counter()
    overrides = tuple(arguments.set)
    config = load_config(arguments.config, overrides) if arguments.config is not None or overrides else None

    def on_module(module: Module) -> None:
        there = f", {module.loaded} there already" if module.loaded else ""
        print(f"{module.name:40}{module.seconds:6.1f} s  {module.compiled} compiled{there}", flush=True)

    if config is not None:
        os.environ.setdefault("WINGLINE_PRECISION", "double")  # as what flies with it
    names = None if config is None else flight_modules(estimator_modules(config.estimator))
    modules = compile_shown(names, Console(stderr=True), on_module)
    folder = os.path.commonpath([module.folder for module in modules])
    print(f"ready in {time.perf_counter() - start:.1f} s; kept in {folder}")
    return 0


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
