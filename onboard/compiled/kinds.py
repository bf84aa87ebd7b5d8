"""The types of a kernel's arguments, and the options with which kernels are compiled."""

from collections.abc import Callable
from typing import Any, Final, NamedTuple


class ArrayKind(NamedTuple):
    """The type of an array: its elements, its axes and its layout.

    `layout` is "a" for any stride, "c" for no gaps, "w" for no gaps and writable, "m" for any stride and writable.
    """

    element: str
    ndim: int
    layout: str = "a"


class RecordKind(NamedTuple):
    """The type of a NamedTuple of a class, or of any tuple if the class is `tuple`."""

    of: type
    fields: tuple[Any, ...]


FLOAT: Final = "d"
INT: Final = "l"
UNSIGNED: Final = "u"
BOOL: Final = "?"


def array(element: str, ndim: int) -> ArrayKind:
    """An array of any stride."""
    return ArrayKind(element, ndim)


def packed(element: str, ndim: int) -> ArrayKind:
    """An array to be read, without gaps in memory."""
    return ArrayKind(element, ndim, "c")


def out(element: str, ndim: int = 2) -> ArrayKind:
    """An array to be written into, without gaps in memory."""
    return ArrayKind(element, ndim, "w")


def record(kind: type, *fields: Any) -> RecordKind:
    """A NamedTuple of these fields, or a plain `tuple`; arguments must match exactly.

    No array is converted, whether read-only or with gaps.
    """
    return RecordKind(kind, fields)


def like(value: Any) -> Any:
    """The type of a value that has the types of this one: numbers, and tuples of them."""
    if isinstance(value, tuple):
        return RecordKind(type(value), tuple(like(each) for each in value))
    return {bool: BOOL, int: INT, float: FLOAT}[type(value)]


VECTOR: Final = array(FLOAT, ndim=1)
ROWS: Final = array(FLOAT, ndim=2)  # a matrix, or states one a row
CUBE: Final = array(FLOAT, ndim=3)
OUT: Final = out(FLOAT, ndim=2)
FLAGS: Final = array(BOOL, ndim=1)
INDICES: Final = array(INT, ndim=1)
SHORT: Final[dict[Any, Any]] = {
    "f": FLOAT, "out": OUT, "packed 2": packed(FLOAT, 2), "packed 3": packed(FLOAT, 3),
}  # fmt: skip


def signature(*arguments: Any) -> tuple[Any, ...]:
    """Return the types of a kernel's arguments from a short form.

    An int stands for an array of that many dimensions, "packed 2" for one without gaps, "out" for a matrix to
    write into, "f" for a number; a type stands for itself.
    """
    return tuple(array(FLOAT, a) if isinstance(a, int) else SHORT.get(a, a) for a in arguments)


# Kernels that create arrays. They keep Python's lock: to give it back and take it again is 4 % of a single step,
# and nothing is gained unless a call lasts milliseconds. The loop over a record gives it back.
MAKING: Final[dict[str, Any]] = {"error_model": "numpy"}

# Kernels that only fill the arrays they are given. One that creates arrays counts references to every array it
# sees: a handful of locked instructions for each slice. These do not, and the compiler refuses one if it starts to
# create arrays. Without that switch the numbers are the same.
FILLING: Final[dict[str, Any]] = MAKING | {"_nrt": False}

# A product and a sum may be rounded once, as the processor can; they are never reordered.
CONTRACTED: Final[dict[str, Any]] = {"fastmath": {"contract"}}


def name_of(function: Callable[..., Any]) -> str:
    """A kernel's name in the extension module."""
    return f"{function.__module__}.{function.__qualname__}"
