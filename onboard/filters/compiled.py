"""How kernels are compiled: the array types of their signatures, and their options.

Signatures are given, so that nothing is ever compiled in flight: it happens when a module is first imported on a
computer (`onboard compile` does it ahead), and the machine code is kept on disk; a wheel for a platform brings it
(`shipped`). Arguments are declared read-only and of any stride, which spares callers copies and Numba one
compilation for each combination.
`NUMBA_DISABLE_JIT=1` runs the same code in Python.

Filters are for both precisions, and no flight is in single precision. A program that flies says so before it
loads them (`WINGLINE_PRECISION=double`), and spares what is for single precision, two fifths of all machine code.

Where nothing else reports it, the first kernel that is compiled is announced on standard error: it takes a minute
or two.
"""

import os
from typing import Any, Final

from numba import typeof, types

from onboard.filters import numba_internals, shipped

PRECISIONS: Final = (
    (types.float64,) if os.environ.get("WINGLINE_PRECISION") == "double" else (types.float64, types.float32)
)

numba_internals.load_without_scipy()
numba_internals.keep_cache_out_of_relative_folders()
numba_internals.keep_cache_files_whole(
    f"{__package__}: machine code on disk was damaged, perhaps by a power cut; it is deleted and compiled anew"
)
shipped.use()
numba_internals.announce_compiling(
    __name__.partition(".")[0],
    f"{__package__}: compiling for this computer, once, up to two minutes (ahead: python -m {__package__})",
)


def array(dtype: Any, ndim: int, *, readonly: bool = True) -> Any:
    """An array of any stride."""
    return types.Array(dtype, ndim, "A", readonly=readonly)


def packed(dtype: Any, ndim: int) -> Any:
    """An array to be read, without gaps in memory."""
    return types.Array(dtype, ndim, "C", readonly=True)


def out(dtype: Any, ndim: int = 2) -> Any:
    """An array to be written into, without gaps in memory."""
    return types.Array(dtype, ndim, "C")


def record(kind: Any, *fields: Any) -> Any:
    """A NamedTuple of such fields, or a plain `tuple`. An argument must have exactly these. Nothing is converted:
    neither a whole number to a float, nor an array that is read-only or has gaps."""
    tuples: Any = types.BaseTuple
    return tuples.from_types(fields, None if kind is tuple else kind)


def like(value: Any) -> Any:
    """The type of a value that has the types of this one."""
    found: Any = typeof
    return found(value)


VECTOR: Final = array(types.float64, 1)
ROWS: Final = array(types.float64, 2)  # a matrix, or states one a row
CUBE: Final = array(types.float64, 3)
OUT: Final = out(types.float64)
FLAGS: Final = array(types.boolean, 1)
INDICES: Final = array(types.int64, 1)


def signatures(*arguments: Any) -> list[Any]:
    """The signatures of a kernel in the precisions of this process. An int stands for an array of that many
    dimensions, "packed 2" for one without gaps, "out" for a matrix to write into, "f" for a number; a type stands
    for itself."""
    made = []
    for dtype in PRECISIONS:
        kinds = {"f": dtype, "out": out(dtype), "packed 2": packed(dtype, 2), "packed 3": packed(dtype, 3)}
        made.append(tuple(array(dtype, a) if isinstance(a, int) else kinds.get(a, a) for a in arguments))
    return made


# Kernels that create arrays. They keep Python's lock: to give it back and take it again is 4 % of a single step,
# and nothing is gained unless a call lasts milliseconds. The loop over a record gives it back.
MAKING: Final[dict[str, Any]] = {"cache": True, "error_model": "numpy"}

# Kernels that only fill the arrays they are given. One that creates arrays counts references to every array it
# sees: a handful of locked instructions for each slice, and a block of memory to count in for each argument.
# These do not, and the compiler refuses one that starts to create arrays. Without that switch the numbers are
# the same.
FILLING: Final[dict[str, Any]] = MAKING | numba_internals.without_reference_counts()

# A product and a sum may be rounded once, as the processor can; they are never reordered.
CONTRACTED: Final[dict[str, Any]] = {"fastmath": {"contract"}}
