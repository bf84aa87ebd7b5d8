"""Filters: arithmetic on arrays, generic over models. No time, no input or output, no configuration.

    from onboard.filters import Belief, unscented      # a module holds one family: start, predict, update
    from onboard.filters import methods                # every filter by name; they are found in this folder

To import this package compiles and loads nothing. A module loads at its first use (0.1 s, once compiled).
`kernels` holds the compiled loops and is private to this package; `inline` exports those that other kernels may
call.
"""

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError, Update

__all__ = ["Belief", "FilterError", "Method", "NotPositiveDefiniteError", "Update", "methods", "modules"]


def modules() -> Iterator[ModuleType]:
    """Every public module of this folder, imported, in alphabetical order."""
    for found in iter_modules(__path__):
        if not found.name.startswith("_"):
            yield import_module(f"{__name__}.{found.name}")


def methods() -> dict[str, Method]:
    """Every filter by its name: what the modules of this folder export as METHODS.

    Raises ValueError when two have one name.
    """
    found: dict[str, Method] = {}
    for module in modules():
        for method in getattr(module, "METHODS", ()):
            if method.name in found:
                raise ValueError(f"two filter methods are called {method.name!r}")
            found[method.name] = method
    return found


def __getattr__(name: str) -> Any:
    """Load a module of this folder when it is first asked for."""
    if not name.startswith("_") and any(found.name == name for found in iter_modules(__path__)):
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
