"""Filters as arithmetic on arrays, generic over models.

They have no time, no input or output, and no configuration.

    from onboard.filters import Belief, unscented      # a module holds one family: start, predict, update
    from onboard.filters import methods                # every filter by name, from the modules of this folder
    from onboard.filters import Model, run, smooth     # a whole record at once

Importing this package compiles and loads nothing. A module loads at its first use (0.1 s, once compiled).
`kernels` holds the compiled loops and is private to this package; `inline` exports those that other kernels may
call.
"""

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Any, Final

from onboard.filters.belief import Belief, Method, Update
from onboard.filters.errors import FilterError, NotPositiveDefiniteError

# Module of each name that loads at its first use. Their types are in __init__.pyi: every kernel imports this
# package, and would be compiled again after a change of any module that is imported here.
LAZY: Final = {
    "LinearModel": "state_space",
    "Model": "state_space",
    "Run": "runs",
    "Step": "state_space",
    "expectation_maximisation": "estimation",
    "log_likelihood": "runs",
    "maximum_likelihood": "estimation",
    "method": "families",
    "run": "runs",
    "simulate": "simulation",
    "smooth": "smoothers",
    "smooth_modes": "mode_smoothing",
    "smooth_particles": "particle_smoothing",
}

__all__ = ["Belief", "FilterError", "Method", "NotPositiveDefiniteError", "Update", "methods", "modules"]
__all__ += list(LAZY)


def modules() -> Iterator[ModuleType]:
    """Yield every public module of this folder, imported, in alphabetical order."""
    for found in iter_modules(__path__):
        if not found.name.startswith("_"):
            yield import_module(f"{__name__}.{found.name}")


def methods() -> dict[str, Method]:
    """Return every filter by its name, from METHODS of the modules of this folder.

    Raises
    ------
    ValueError
        If two filters have one name.
    """
    found: dict[str, Method] = {}
    for module in modules():
        for method in getattr(module, "METHODS", ()):
            if method.name in found:
                raise ValueError(f"two filter methods are called {method.name!r}")
            found[method.name] = method
    return found


def __dir__() -> list[str]:
    """Return the names above, and the modules of this folder, loaded or not."""
    return sorted({*__all__, *(found.name for found in iter_modules(__path__) if not found.name.startswith("_"))})


def __getattr__(name: str) -> Any:
    """Load a name, or a module of this folder, at its first use."""
    if name in LAZY:
        return getattr(import_module(f"{__name__}.{LAZY[name]}"), name)
    if not name.startswith("_") and any(found.name == name for found in iter_modules(__path__)):
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
