"""The settings that a Zenoh file contains.

Zenoh itself reports only differences from its defaults, but a setting in the file must apply even if it equals a
default.
"""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Final

import yaml

MAX_SETTING_COUNT: Final = 10_000  # nested YAML aliases can create any number in a few lines
TOKEN: Final = re.compile(
    r"""//[^\n\r\u2028\u2029]*|/\*.*?\*/"""  # comments
    r"""|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'"""
    r"""|[{}\[\],:]|[^\s{}\[\],:"'/]+""",
    re.DOTALL,
)


def stated_in(path: str) -> frozenset[str]:
    """Return the paths of all settings in a JSON5 or YAML file, such as `connect/retry`.

    Zenoh has already read the file. Raises OSError, ValueError.
    """
    text = Path(path).read_text(encoding="utf-8-sig")
    if path.lower().endswith((".yaml", ".yml")):
        stated = frozenset(islice(_of_tree(yaml.safe_load(text), ""), MAX_SETTING_COUNT + 1))
        if len(stated) > MAX_SETTING_COUNT:
            raise ValueError(f"it states more than {MAX_SETTING_COUNT} settings")
        return stated
    return frozenset(_of_json5(text))


def is_stated(key: str, stated: frozenset[str]) -> bool:
    """Whether the file contains this setting or a part of it."""
    return any(path == key or path.startswith(f"{key}/") for path in stated)


def _of_json5(text: str) -> Iterator[str]:
    tokens = [t for t in TOKEN.findall(text) if not t.startswith(("//", "/*"))]
    place: list[str | None] = []  # the key in each object that is open; None: an array
    for part, after in zip(tokens, [*tokens[1:], ""], strict=True):
        if part in "{[":
            place.append("" if part == "{" else None)
        elif part in "}]":
            place.pop()
        elif after == ":" and place and None not in place:
            place[-1] = part[1:-1] if part[0] in "\"'" else part
            yield "/".join(str(key) for key in place)


def _of_tree(tree: Any, prefix: str) -> Iterator[str]:
    for key, value in tree.items() if isinstance(tree, dict) else ():
        yield f"{prefix}{key}"
        yield from _of_tree(value, f"{prefix}{key}/")
