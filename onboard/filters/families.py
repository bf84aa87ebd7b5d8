"""One filter by its name, without loading the others.

    method("csvsf-adaptive")    # loads `cubature_smooth`, and its imports

The table is apart from the package because every kernel imports the package: a change of anything that it imports
makes all machine code again.
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
    """Return the full name of a filter's module, without loading it.

    Raises
    ------
    KeyError
        For an unknown filter, with the known names.
    """
    if name not in MODULES:
        raise KeyError(f"no filter named {name!r}; there are: {', '.join(MODULES)}")
    return f"{__package__}.{MODULES[name]}"


def method(name: str) -> Method:
    """Return a filter by its name. Loads its module and its imports.

    Raises
    ------
    KeyError
        For an unknown filter, with the known names.
    """
    family = import_module(module_name(name))
    own = (family.METHOD,) if hasattr(family, "METHOD") else ()  # the particle filter, apart from `methods()`
    found: Method = next(one for one in (*getattr(family, "METHODS", ()), *own) if one.name == name)
    return found
