"""What is compiled of one module, on its way to the extension module."""

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
    """What a module with kernels gives: functions that Python may call, and an object file."""

    entries: list[Entry]
    object_file: bytes
