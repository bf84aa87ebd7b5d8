"""Kernels: Python functions compiled ahead of flight into one extension module.

A kernel has the decorator `@kernel`. `python -m onboard.compiled` compiles all of them; in flight there is neither
compiler nor Numba. A kernel with types of arguments can be called from Python; one without is compiled into its
callers. Arguments are declared read-only and of any stride, which spares callers copies. A call with other types
raises TypeError.

`WINGLINE_KERNELS=python` runs the same code in Python, to debug it.
"""

import os
import sys
from collections.abc import Callable
from typing import Any, Final

from onboard.compiled.kinds import BOOL as BOOL
from onboard.compiled.kinds import CONTRACTED as CONTRACTED
from onboard.compiled.kinds import CUBE as CUBE
from onboard.compiled.kinds import FILLING as FILLING
from onboard.compiled.kinds import FLAGS as FLAGS
from onboard.compiled.kinds import FLOAT as FLOAT
from onboard.compiled.kinds import INDICES as INDICES
from onboard.compiled.kinds import INT as INT
from onboard.compiled.kinds import MAKING as MAKING
from onboard.compiled.kinds import OUT as OUT
from onboard.compiled.kinds import ROWS as ROWS
from onboard.compiled.kinds import UNSIGNED as UNSIGNED
from onboard.compiled.kinds import VECTOR as VECTOR
from onboard.compiled.kinds import ArrayKind as ArrayKind
from onboard.compiled.kinds import array as array
from onboard.compiled.kinds import like as like
from onboard.compiled.kinds import name_of
from onboard.compiled.kinds import out as out
from onboard.compiled.kinds import packed as packed
from onboard.compiled.kinds import record as record
from onboard.compiled.kinds import signature as signature
from onboard.compiled.machine import REPAIR, MachineCodeError, machine_code

MODES: Final = ("machine", "python", "build")
MODE: Final = os.environ.get("WINGLINE_KERNELS", MODES[0])


def kernel(takes: tuple[Any, ...] | None = None, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a kernel that takes these types, also from Python; None, from kernels alone."""
    if MODE not in MODES:
        raise MachineCodeError(f"WINGLINE_KERNELS: {MODE} is unknown; expected one of {', '.join(MODES)}")
    if MODE == "python" or (MODE == "machine" and takes is None):
        return lambda function: function
    if MODE == "machine":
        return _bound
    from onboard.compiled import native  # noqa: PLC0415 - it imports Numba, which takes half a second

    return lambda function: native.declared(function, takes, options)


def _bound(function: Any) -> Any:
    """The machine code of a function. Raises MachineCodeError."""
    found, name = machine_code(), name_of(function)
    try:
        classes = (each.split(":") for each in found.class_names(name).split())
        return found.bind(name, (tuple, *(getattr(sys.modules[module], kind) for module, kind in classes)))
    except KeyError:
        raise MachineCodeError(f"{name}: there is no machine code of it; {REPAIR}") from None
