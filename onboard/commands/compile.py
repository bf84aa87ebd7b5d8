"""`onboard compile`: the filters' machine code, before the first flight."""

import argparse
import os
import time

from onboard.commands.compiling import Module, needed_by_flight
from onboard.commands.console import Console
from onboard.commands.progress import compile_shown
from onboard.config import estimator_modules, load_config


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
    names = None if config is None else needed_by_flight(estimator_modules(config.estimator))
    modules = compile_shown(names, Console(stderr=True), on_module)
    folder = os.path.commonpath([module.folder for module in modules])
    print(f"ready in {time.perf_counter() - start:.1f} s; kept in {folder}")
    return 0
