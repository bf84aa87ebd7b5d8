"""What camera points, radar detections and pseudoranges have in common as JSON documents."""

import json
import math
import re
from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec

from onboard.messages import (
    CameraDetections,
    CameraPoints,
    Detection,
    Pseudoranges,
    RadarDetection,
    RadarDetections,
    Record,
    SatelliteRange,
    WarmState,
)
from onboard.messages.causes import Cause, Reason

LATEST_NS: Final = 2**63
LARGEST: Final = 65_536  # bytes; three labelled points are 400, a radar's echo a hundred
NAME: Final = re.compile(r"[A-Za-z0-9_.-]{1,64}")  # of a camera or a radar: one part of a key

ROWS: Final[dict[type[Record], tuple[str, type[Record]]]] = {  # the field that lists what was measured
    CameraDetections: ("detections", Detection),
    RadarDetections: ("detections", RadarDetection),
    Pseudoranges: ("satellites", SatelliteRange),
}

D = TypeVar("D", CameraDetections, CameraPoints, RadarDetections, Pseudoranges, WarmState)
Refuse = Callable[[Reason], None]


class BadDocumentError(ValueError):
    """A document that cannot be used; the message names the field."""

    def __init__(self, words: str, cause: Cause = Cause.DOCUMENT) -> None:
        super().__init__(words)
        self.why = Reason(cause, words)


def parse(decoder: msgspec.json.Decoder[D], data: bytes) -> D:
    """The record of one JSON document. Whole numbers may be written with a point.

    Raises BadDocumentError when it is not JSON in UTF-8, too large, a field is missing, unknown or of the wrong
    type, or the time does not fit into 64 bits (it could not be published again).
    """
    return parse_rows(decoder, data, raise_reason)[0]


def parse_rows(decoder: msgspec.json.Decoder[D], data: bytes, refuse: Refuse) -> tuple[D, list[int]]:
    """The record of one JSON document, and the number that each of its rows (`ROWS`) has in the document.

    A row that cannot be read costs the others nothing: it is left out, and `refuse` is called with the reason.
    Raises BadDocumentError as `parse` does, for all that is not in a row.
    """
    _check_length(data)
    try:
        document = decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError):  # the latter for text that is not UTF-8
        return _row_by_row(decoder.type, load(data, decoder.type), refuse)
    return _whole_document(document)


def parse_tree(kind: type[D], data: bytes, refuse: Refuse) -> tuple[D, list[int], Any]:
    """The same as `parse_rows`, and the document as dictionaries and lists, with what its record does not have."""
    _check_length(data)
    try:
        tree = msgspec.json.decode(data)
        document = msgspec.convert(tree, kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        tree = load(data, kind)
        document, numbers = _row_by_row(kind, tree, refuse)
        return document, numbers, tree
    document, numbers = _whole_document(document)
    return document, numbers, tree


def _check_length(data: bytes) -> None:
    if len(data) > LARGEST:
        raise BadDocumentError(f"the document has more than {LARGEST} bytes")


def _whole_document(document: D) -> tuple[D, list[int]]:
    """A document whose rows can all be read, and their numbers."""
    name, _ = ROWS.get(type(document), ("", Record))
    return _checked(document), list(range(len(getattr(document, name, ()))))


def _checked(document: D) -> D:
    if not -LATEST_NS < document.t_ns < LATEST_NS:
        raise BadDocumentError("a time must fit into 64 bits - at `$.t_ns`")
    return document


def parse_measurements(
    decoder: msgspec.json.Decoder[D],
    data: bytes,
    is_possible: Callable[[Any], bool],
    possible: str,
    refuse: Refuse,
) -> D:
    """The record of one JSON document with those of its rows that can be measured, as `possible` says. Raises
    BadDocumentError when there are rows and none of them can: it is no measurement of nothing."""
    reasons: list[Reason] = []
    document, numbers = parse_rows(decoder, data, reasons.append)
    name, _ = ROWS[decoder.type]
    found = []
    for i, row in zip(numbers, getattr(document, name), strict=True):
        if is_possible(row):
            found.append(row)
        else:
            reasons.append(Reason(Cause.DOCUMENT, f"{possible} - at `$.{name}[{i}]`"))
    if reasons and not found:
        raise_reason(reasons[0])
    for reason in reasons:
        refuse(reason)
    return msgspec.structs.replace(document, **{name: tuple(found)})


def load(data: bytes, kind: type[Record]) -> Any:
    """A JSON document as dictionaries and lists. NaN and Infinity, which are not JSON but are written by Python,
    are read: the check of the field that holds them names it. Raises BadDocumentError."""
    try:
        return msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as strict:
        try:
            return json.loads(data.decode("utf-8"))
        except (ValueError, RecursionError):
            raise BadDocumentError(f"{strict}; expected one JSON object of {kind.__name__}") from strict


def _row_by_row(kind: type[D], tree: Any, refuse: Refuse) -> tuple[D, list[int]]:
    """The record without the rows that cannot be read, and the numbers of those that can."""
    name, row_kind = ROWS.get(kind, ("", Record))
    rows = tree.get(name) if isinstance(tree, dict) else None
    if not isinstance(rows, list):
        return _checked(_convert(tree, kind, "")), []
    document = _convert({**_stated(tree, kind, refuse), name: []}, kind, "")
    found: dict[int, Any] = {}
    for i, row in enumerate(rows):
        try:
            found[i] = _convert(row, row_kind, f".{name}[{i}]")
        except BadDocumentError as error:
            refuse(error.why)
    return _checked(msgspec.structs.replace(document, **{name: tuple(found.values())})), list(found)


def _stated(tree: dict[str, Any], kind: type[Record], refuse: Refuse) -> dict[str, Any]:
    """A document without those of its own fields that are null but may be left out: null states nothing. Each is
    named by `refuse`."""
    fields = msgspec.structs.fields(kind)
    empty = {f.encode_name for f in fields if not f.required and tree.get(f.encode_name, f) is None}
    for field in sorted(empty):
        refuse(Reason(Cause.IGNORED, f"(the rest is used) null is taken as not stated - at `$.{field}`"))
    return {key: value for key, value in tree.items() if key not in empty}


def _convert(tree: Any, kind: type[Any], at: str) -> Any:
    """A record of part of a document, which stands at `at`. Raises BadDocumentError."""
    try:
        return msgspec.convert(_whole(tree, at), kind)
    except msgspec.ValidationError as error:
        reason = str(error)
        if not at:
            raise BadDocumentError(f"{reason}{_known(kind, reason)}") from error
        named = reason.replace(" at `$", f" at `${at}") if " at `$" in reason else f"{reason} - at `${at}`"
        raise BadDocumentError(named) from error
    except RecursionError as error:
        raise BadDocumentError(f"lists or objects within each other without end - at `${at}`") from error


def _whole(value: Any, at: str) -> Any:
    """The same with whole numbers as integers, which records take for either. Raises BadDocumentError, with its
    place, for a number that is none."""
    if isinstance(value, dict):
        return {name: _whole(inner, f"{at}.{name}") for name, inner in value.items()}
    if isinstance(value, list):
        return [_whole(inner, f"{at}[{i}]") for i, inner in enumerate(value)]
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        raise BadDocumentError(f"expected a finite number, got {value} - at `${at}`")
    return int(value) if value.is_integer() and abs(value) < LATEST_NS else value


def raise_reason(why: Reason) -> None:
    """Refuse a whole document for one of its rows, where nobody counts these."""
    raise BadDocumentError(why.words, why.cause)


def _known(kind: type[Record], error: str) -> str:
    """The names of the fields, where one of the document itself is missing or unknown."""
    if " at `$" in error:
        return ""
    return f"; the fields of {kind.__name__} are {', '.join(f.name for f in msgspec.structs.fields(kind))}"


def check_name(name: str, field: str) -> None:
    """Raise BadDocumentError unless this can be the name of a sensor. Names go into keys and estimates, so they
    must be plain and short; `..` would be a way out of a folder."""
    if not NAME.fullmatch(name) or name.startswith("."):
        raise BadDocumentError(f"a name is of letters, digits and -_., 64 at most - at `$.{field}`")
