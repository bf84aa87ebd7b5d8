"""Parsing that is common to all JSON documents."""

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

MAX_TIME_NS: Final = 2**63  # the range of a signed 64-bit integer
MAX_DOCUMENT_BYTES: Final = 65_536  # three labelled points have 400, a radar's echo 100
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
    """Parse one JSON document; return its record and the index of each kept row (`ROWS`).

    `refuse` receives the reason for each unreadable row, which is left out. Raises BadDocumentError as `parse`
    does, for all that is not in a row.
    """
    _check_length(data)
    try:
        document = decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError):  # the latter for text that is not UTF-8
        return _row_by_row(decoder.type, load(data, decoder.type), refuse)
    return _whole_document(document)


def parse_tree(kind: type[D], data: bytes, refuse: Refuse) -> tuple[D, list[int], Any]:
    """Parse like `parse_rows`, and also return the document as dictionaries and lists."""
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
    if len(data) > MAX_DOCUMENT_BYTES:
        raise BadDocumentError(f"the document has more than {MAX_DOCUMENT_BYTES} bytes")


def _whole_document(document: D) -> tuple[D, list[int]]:
    """A document whose rows can all be read, and their numbers."""
    name, _ = ROWS.get(type(document), ("", Record))
    return _checked(document), list(range(len(getattr(document, name, ()))))


def _checked(document: D) -> D:
    if not -MAX_TIME_NS < document.t_ns < MAX_TIME_NS:
        raise BadDocumentError("a time must fit into 64 bits - at `$.t_ns`")
    return document


def parse_measurements(
    decoder: msgspec.json.Decoder[D],
    data: bytes,
    is_possible: Callable[[Any], bool],
    possible: str,
    refuse: Refuse,
) -> D:
    """Parse one JSON document and keep the rows that are possible measurements.

    Raises BadDocumentError when no row of several is possible: an empty record would claim that nothing was
    measured.
    """
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
    """Load a JSON document as dictionaries and lists. Raises BadDocumentError.

    NaN and Infinity, which Python writes although JSON has none, are read, so that the check of their field names
    it.
    """
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
    """Remove null from optional fields of a document; each is reported to `refuse`."""
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
    """Convert whole numbers to integers, recursively. Raises BadDocumentError with the place."""
    if isinstance(value, dict):
        return {name: _whole(inner, f"{at}.{name}") for name, inner in value.items()}
    if isinstance(value, list):
        return [_whole(inner, f"{at}[{i}]") for i, inner in enumerate(value)]
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        raise BadDocumentError(f"expected a finite number, got {value} - at `${at}`")
    return int(value) if value.is_integer() and abs(value) < MAX_TIME_NS else value


def raise_reason(why: Reason) -> None:
    """Refuse a whole document for one of its rows, where nobody counts these."""
    raise BadDocumentError(why.words, why.cause)


def _known(kind: type[Record], error: str) -> str:
    """The names of the fields, where one of the document itself is missing or unknown."""
    if " at `$" in error:
        return ""
    return f"; the fields of {kind.__name__} are {', '.join(f.name for f in msgspec.structs.fields(kind))}"


def check_name(name: str, field: str) -> None:
    """Raise BadDocumentError unless the name of a sensor is plain and short.

    Names go into keys and estimates; `..` would be a way out of a folder.
    """
    if not NAME.fullmatch(name) or name.startswith("."):
        raise BadDocumentError(f"a name is of letters, digits and -_., 64 at most - at `$.{field}`")
