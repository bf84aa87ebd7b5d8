"""`onboard compile`: the filters' machine code, before the first flight."""

import argparse
import os
import time

from rich.console import Console

from onboard.commands.compiling import Module, needed_by_flight
from onboard.commands.progress import compile_shown
from onboard.config import estimator_modules, named_estimators, parse_config, read_table


def main(arguments: argparse.Namespace) -> int:
    """Compile everything, or what a configuration flies with. Raises UserError."""
    start = time.perf_counter()
    overrides = tuple(arguments.set)
    table = read_table(arguments.config, overrides) if arguments.config is not None or overrides else None

    def on_module(module: Module) -> None:
        there = f", {module.loaded} there already" if module.loaded else ""
        print(f"{module.name:40}{module.seconds:6.1f} s  {module.compiled} compiled{there}", flush=True)

    names = None if table is None else needed_by_flight(estimator_modules(named_estimators(table)))
    modules = compile_shown(names, Console(stderr=True), on_module)
    if table is not None:
        parse_config(table)  # its mistakes are better reported now than before the flight
    folder = os.path.commonpath([module.folder for module in modules])
    print(f"ready in {time.perf_counter() - start:.1f} s; kept in {folder}")
    return 0
