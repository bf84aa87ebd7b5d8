"""The compiled parts of one module, before they are linked."""

from typing import NamedTuple


class Entry(NamedTuple):
    """A function in an object file that Python may call, as a row of `kernels` in boundary.c."""

    name: str
    takes: str
    gives: str
    class_names: str
    symbol: str
    releases_lock: bool


class Part(NamedTuple):
    """The functions for Python and the object file of a module with kernels."""

    entries: list[Entry]
    object_file: bytes
