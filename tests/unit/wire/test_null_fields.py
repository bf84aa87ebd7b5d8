"""A field of the document itself that is null costs no image where it may be left out, and is named."""

import json

import msgspec
import pytest

from onboard.messages import CameraDetections, Cause, Reason
from onboard.wire.documents.document import BadDocumentError, parse_rows

BOX = {"box": {"u_px": 1.0, "v_px": 2.0, "width_px": 3.0, "height_px": 4.0}}
HEAD = {"t_ns": 5, "clock": "host", "camera": "front", "detections": [BOX]}
DECODER = msgspec.json.Decoder(CameraDetections)


def test_what_may_be_left_out_may_be_null() -> None:
    reasons: list[Reason] = []
    document, numbers = parse_rows(DECODER, json.dumps(HEAD | {"camera": None}).encode(), reasons.append)
    assert document.camera == CameraDetections(t_ns=5, clock=document.clock).camera
    assert (len(document.detections), numbers) == (1, [0])
    assert reasons == [(Cause.IGNORED, "(the rest is used) null is taken as not stated - at `$.camera`")]


@pytest.mark.parametrize("field", ["t_ns", "clock"])
def test_what_is_required_may_not(field: str) -> None:
    with pytest.raises(BadDocumentError, match=rf"\$\.{field}"):
        parse_rows(DECODER, json.dumps(HEAD | {field: None}).encode(), list[Reason]().append)
