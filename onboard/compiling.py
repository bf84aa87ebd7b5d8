"""Compile every kernel ahead, so that the first flight does not wait for it. What is compiled stays on disk."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import onboard.filters
import onboard.models

PACKAGES = (onboard.filters, onboard.models)


class Module(NamedTuple):
    """What a module's kernels were: how many variants (of argument types) were loaded and compiled, in how many
    seconds, and where the machine code is kept."""

    name: str
    loaded: int
    compiled: int
    seconds: float
    folder: str


def compile_all(clock: Callable[[], float]) -> Iterator[Module]:
    """Import every module that has kernels; they declare their types, so importing compiles what is not on disk.

    `clock` gives seconds. Yields each module once it is ready.
    """
    for package in PACKAGES:
        modules = pkgutil.iter_modules(package.__path__, f"{package.__name__}.")
        for found in sorted(
            modules, key=lambda m: "._kernels" not in m.name
        ):  # each timed before another imports it
            start = clock()
            module = importlib.import_module(found.name)
            seconds = clock() - start
            kernels = [k for k in vars(module).values() if _declared(k) and k.py_func.__module__ == found.name]
            if kernels:
                stats = [kernel.stats for kernel in kernels]
                loaded = sum(sum(s.cache_hits.values()) for s in stats)
                compiled = sum(sum(s.cache_misses.values()) for s in stats)
                yield Module(found.name, loaded, compiled, seconds, str(stats[0].cache_path))


def _declared(value: Any) -> bool:
    return bool(getattr(value, "nopython_signatures", ())) and hasattr(value, "stats")
