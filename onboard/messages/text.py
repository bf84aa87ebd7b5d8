"""Sanitising of text from outside, so that it can be stored, published, drawn and printed.

Input is sanitised where it is read, and again where it is shown to a person: another program may have published
it.
"""

import re
from typing import Any, Final, TypeVar

import msgspec

from onboard.messages.base import Record

MAX_NAME_LENGTH: Final = 64  # of a name from outside, such as a detector's class
MAX_LINE_LENGTH: Final = 1000  # of a line for a person
ELLIPSIS: Final = "..."
NUMBER_PATTERN: Final = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")  # not inside a name
QUOTED_PATTERN: Final = re.compile(r"`[^`]*`?")  # the closing quote may have been cut off

R = TypeVar("R", bound=Record)


def plain(text: str, most: int = MAX_NAME_LENGTH) -> str:
    """Return one line of at most `most` letters.

    Unprintable characters become `?`: escape sequences of terminals, line ends, and marks that change the
    direction of writing.
    """
    line = text if len(text) <= most else f"{text[: most - len(ELLIPSIS)]}{ELLIPSIS}"
    return line if line.isprintable() else "".join(c if c.isprintable() else "?" for c in line)


def without_numbers(text: str) -> str:
    """Return a text with each number masked.

    Texts that differ only in numbers then are equal.
    """
    return NUMBER_PATTERN.sub("#", text)


def without_names(text: str) -> str:
    """Return a text with each quotation masked.

    Texts that differ only in quoted names then are equal.
    """
    return QUOTED_PATTERN.sub("`*`", text)


def plain_record(record: R) -> R:
    """Return a record in which every string is one plain line."""
    return msgspec.convert(_plain_tree(msgspec.to_builtins(record)), type(record))


def _plain_tree(tree: Any) -> Any:
    """Return a tree of built-in types in which every string is one plain line."""
    if isinstance(tree, str):
        return plain(tree, MAX_LINE_LENGTH)
    if isinstance(tree, dict):
        return {plain(name): _plain_tree(value) for name, value in tree.items()}
    return [_plain_tree(one) for one in tree] if isinstance(tree, list | tuple) else tree
