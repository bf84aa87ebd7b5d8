"""Text from outside, made fit to be stored, published, drawn and printed. Whoever reads such text cleans it at the
door, and whoever shows it to a person does so again: another program may have published it."""

import re
from typing import Any, Final, TypeVar

import msgspec

from onboard.messages.base import Record

NAME: Final = 64  # letters of a name from outside, such as a detector's class
LINE: Final = 1000  # letters of a line for a person
CUT: Final = "..."
NUMBER: Final = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")  # that is no part of a name
QUOTED: Final = re.compile(r"`[^`]*`?")  # or cut

R = TypeVar("R", bound=Record)


def plain(text: str, most: int = NAME) -> str:
    """One line of at most `most` letters. What is not printable becomes `?`: the escape sequences of terminals,
    line ends, and marks that change the direction of writing."""
    line = text if len(text) <= most else f"{text[: most - len(CUT)]}{CUT}"
    return line if line.isprintable() else "".join(c if c.isprintable() else "?" for c in line)


def without_numbers(text: str) -> str:
    """The same for all texts that differ in numbers alone."""
    return NUMBER.sub("#", text)


def without_names(text: str) -> str:
    """The same for all texts that differ in what they quote alone."""
    return QUOTED.sub("`*`", text)


def plain_record(record: R) -> R:
    """A record with every string in it as `plain` makes a line of it."""
    return msgspec.convert(_plain_tree(msgspec.to_builtins(record)), type(record))


def _plain_tree(tree: Any) -> Any:
    if isinstance(tree, str):
        return plain(tree, LINE)
    if isinstance(tree, dict):
        return {plain(name): _plain_tree(value) for name, value in tree.items()}
    return [_plain_tree(one) for one in tree] if isinstance(tree, list | tuple) else tree
