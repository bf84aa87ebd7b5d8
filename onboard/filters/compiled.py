"""How kernels are compiled, and what those that only fill arrays are spared.

A kernel that makes arrays counts references to every array it sees: a handful of locked instructions for each
slice, and for each argument a block of memory to count in. One that only fills what it is given needs none of
that, and Numba has a switch for it, of its own use and not documented (`_nrt`). With it a kernel that does make an
array is refused by the compiler, so nothing on this path can start to. A Numba without that switch compiles all
alike; the numbers are the same.
"""

from typing import Any, Final

from numba.core.options import DefaultOptions

MAKING: Final[dict[str, Any]] = {"cache": True, "error_model": "numpy"}
FILLING: Final[dict[str, Any]] = MAKING | ({"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {})
# A product and a sum may be rounded once, as the processor can; they are never reordered.
CONTRACTED: Final[dict[str, Any]] = {"fastmath": {"contract"}}
