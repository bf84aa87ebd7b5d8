"""What camera points, radar detections and pseudoranges have in common as JSON documents."""

from typing import Final, TypeVar

import msgspec

from onboard.messages import CameraPoints, Pseudoranges, RadarDetections

LATEST_NS: Final = 2**63

D = TypeVar("D", CameraPoints, RadarDetections, Pseudoranges)


class BadDocumentError(ValueError):
    """A document that cannot be used; the message names the field."""


def parse(decoder: msgspec.json.Decoder[D], data: bytes) -> D:
    """The record of one JSON document.

    Raises BadDocumentError when it is not JSON, a field is missing, unknown or of the wrong type, or the time does
    not fit into 64 bits (it could not be published again).
    """
    try:
        document = decoder.decode(data)
    except msgspec.DecodeError as error:  # ValidationError is one too
        raise BadDocumentError(str(error)) from error
    if not -LATEST_NS < document.t_ns < LATEST_NS:
        raise BadDocumentError("a time must fit into 64 bits - at `$.t_ns`")
    return document
