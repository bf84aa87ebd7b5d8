"""What camera points, radar detections and pseudoranges have in common as JSON documents."""

import re
from typing import Final, TypeVar

import msgspec

from onboard.messages import CameraDetections, CameraPoints, Pseudoranges, RadarDetections, Record

LATEST_NS: Final = 2**63
LARGEST: Final = 65_536  # bytes; three labelled points are 400, a radar's echo a hundred
NAME: Final = re.compile(r"[A-Za-z0-9_.-]{1,64}")  # of a camera or a radar: one part of a key

D = TypeVar("D", CameraDetections, CameraPoints, RadarDetections, Pseudoranges)


class BadDocumentError(ValueError):
    """A document that cannot be used; the message names the field."""


def parse(decoder: msgspec.json.Decoder[D], data: bytes) -> D:
    """The record of one JSON document.

    Raises BadDocumentError when it is not JSON in UTF-8, too large, a field is missing, unknown or of the wrong
    type, or the time does not fit into 64 bits (it could not be published again).
    """
    if len(data) > LARGEST:
        raise BadDocumentError(f"the document has more than {LARGEST} bytes")
    try:
        document = decoder.decode(data)
    except msgspec.ValidationError as error:
        raise BadDocumentError(f"{error}{_known(decoder.type, str(error))}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:  # the latter for text that is not UTF-8
        raise BadDocumentError(f"{error}; expected one JSON object of {decoder.type.__name__}") from error
    if not -LATEST_NS < document.t_ns < LATEST_NS:
        raise BadDocumentError("a time must fit into 64 bits - at `$.t_ns`")
    return document


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
