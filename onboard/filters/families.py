"""One filter by its name, without the others.

    method("csvsf-adaptive")    # loads `cubature_smooth`, and what that imports

The table stands apart from the package because every kernel imports the package: machine code is made anew when
anything that it imports changes.
"""

from importlib import import_module
from typing import Final

from onboard.filters.belief import Method

MODULES: Final = {  # the module of this folder in which each filter is
    "augmented": "augmented",
    "augmented-scaled-1": "augmented",
    "csvsf": "cubature_smooth",
    "csvsf-adaptive": "cubature_smooth",
    "csvsf-printed": "cubature_smooth",
    "csvsf-robust": "cubature_smooth",
    "cubature": "cubature",
    "ensemble": "ensemble",
    "extended": "extended",
    "gauss-hermite": "gauss_hermite",
    "imm": "multiple_model",
    "kalman": "kalman",
    "particle": "particle",
    "posterior-linearisation": "posterior_linearisation",
    "square-root": "square_root",
    "square-root-cubature": "square_root",
    "square-root-downdated": "square_root",
    "square-root-joseph": "square_root",
    "svsf": "smooth_variable_structure",
    "svsf-zero-layer": "smooth_variable_structure",
    "unscented": "unscented",
    "unscented-considered": "unscented",
    "unscented-scaled-0.1": "unscented",
    "unscented-scaled-1": "unscented",
    "vbl-svsf": "smooth_variable_structure",
}


def module_name(name: str) -> str:
    """The whole name of the module in which a filter is, without loading it.

    Raises KeyError, with the known names, for any other.
    """
    if name not in MODULES:
        raise KeyError(f"no filter named {name!r}; there are: {', '.join(MODULES)}")
    return f"{__package__}.{MODULES[name]}"


def method(name: str) -> Method:
    """A filter by its name. Loads its module, and what that imports.

    Raises KeyError, with the known names, for any other.
    """
    family = import_module(module_name(name))
    own = (family.METHOD,) if hasattr(family, "METHOD") else ()  # the particle filter, apart from `methods()`
    found: Method = next(one for one in (*getattr(family, "METHODS", ()), *own) if one.name == name)
    return found
