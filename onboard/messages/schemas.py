"""JSON Schemas and tables of the published records, generated from the records themselves."""

import re
from collections.abc import Iterator
from enum import Enum
from inspect import cleandoc
from types import UnionType
from typing import Any, Final, Literal, Union, get_args, get_origin

import msgspec

from onboard.messages import (
    CameraDetections,
    CameraPoints,
    Cause,
    Estimate,
    Health,
    LeaderState,
    NavState,
    OwnPose,
    Pseudoranges,
    RadarDetections,
    Record,
)

ATTRIBUTES: Final = "Attributes\n----------\n"  # heading of the numpydoc section of fields

PUBLISHED: Final[dict[str, type[Record]]] = {
    "estimate/<name>": Estimate,
    "estimate/<name>/<target>": Estimate,
    "leader": LeaderState,
    "own_state": NavState,
    "ownship": OwnPose,
    "health": Health,
    "camera/<camera>/points": CameraPoints,
    "camera/<camera>/detections": CameraDetections,
    "radar/<radar>/detections": RadarDetections,
    "gnss/<peer>/pseudoranges": Pseudoranges,
}
"""Keys below `onboard/<vehicle>/`, and the records published there as JSON. The daemon reads the last four."""


def key_of(record: Record) -> str:
    """Return the key of a record below the vehicle's prefix.

    Raises KeyError for an unpublished record.
    """
    if isinstance(record, NavState):
        return "own_state"
    if isinstance(record, Estimate):
        return f"estimate/{record.name}" if record.is_primary else f"estimate/{record.name}/{record.target}"
    return {OwnPose: "ownship", Health: "health", LeaderState: "leader"}[type(record)]


def schema(record: type[Record]) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of one record, self-contained."""
    (reference,), components = msgspec.json.schema_components([record], ref_template="#/$defs/{name}")
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return head | reference | {"$defs": components}


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of each published record, by key pattern."""
    return {key: schema(record) for key, record in PUBLISHED.items()}


def describe() -> str:
    """Return Markdown tables of keys, of the fields of each record, and of causes.

    Records inside a record have a table of their own.
    """
    lines = ["| key | record | content |", "|---|---|---|"]
    for key, record in PUBLISHED.items():
        lines.append(f"| `{key}` | [`{record.__name__}`](#{record.__name__.lower()}) | {_summary(record)} |")
    for record in _all_records():
        head = "| field | type | meaning |", "|---|---|---|"
        lines += ["", f"#### {record.__name__}", "", _text(record), "", *head]
        meanings = _meanings(record)
        for field in msgspec.structs.fields(record):
            optional = "" if field.required else ", optional"
            meaning = meanings.get(field.encode_name, "")
            lines.append(f"| `{field.encode_name}` | {_type(field.type)}{optional} | {meaning} |")
    lines += ["", f"#### {Cause.__name__}", "", _text(Cause), "", "| cause | meaning |", "|---|---|"]
    lines += [f"| `{cause.value}` | {cause.meaning} |" for cause in Cause]
    return "\n".join(lines) + "\n"


def _all_records() -> list[type[Record]]:
    """Return the published records, each followed by the records inside it; each once."""
    found: dict[type[Record], None] = {}

    def visit(record: type[Record]) -> None:
        if record in found:
            return
        found[record] = None
        for field in msgspec.structs.fields(record):
            for part in _parts(field.type):
                if isinstance(part, type) and issubclass(part, Record):
                    visit(part)

    for record in PUBLISHED.values():
        visit(record)
    return list(found)


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and all annotations in its brackets."""
    yield annotation
    for part in get_args(annotation):
        yield from _parts(part)


def _text(record: type) -> str:
    """Return a class's docstring on one line, without its section of attributes."""
    return _line(cleandoc(record.__doc__ or "").partition(ATTRIBUTES)[0])


def _line(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def _meanings(record: type) -> dict[str, str]:
    """Return the descriptions of fields in the sections of attributes, by name.

    Those of the bases are included.
    """
    meanings: dict[str, str] = {}
    for base in reversed(record.__mro__):
        section = cleandoc(base.__doc__ or "").partition(ATTRIBUTES)[2]
        for names, description in re.findall(r"^(\w[\w, ]*)\n((?:    .*\n?)+)", section, re.MULTILINE):
            meanings |= dict.fromkeys(names.split(", "), _line(description))
    return meanings


def _summary(record: type[Record]) -> str:
    """Return the first sentence of the docstring."""
    return _text(record).split(". ")[0].rstrip(".")


def _type(annotation: Any) -> str:
    """Return the JSON type of an annotation, as Markdown for a table."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        return " or ".join(_type(a) for a in arguments)
    if origin is Literal:
        return ", ".join(f"`{a}`" for a in arguments)
    if origin is dict:
        return f"object of {_type(arguments[1])}"
    if origin is tuple:
        if arguments[-1] is Ellipsis:
            return f"array of {_type(arguments[0])}"
        return f"{len(arguments)} × {_type(arguments[0])}"
    if annotation is type(None):
        return "null"
    if issubclass(annotation, Record | Cause):
        return f"[`{annotation.__name__}`](#{annotation.__name__.lower()})"
    if issubclass(annotation, Enum):
        return ", ".join(f"`{member.value}`" for member in annotation)
    return {float: "number", int: "integer", str: "string", bool: "boolean"}[annotation]
