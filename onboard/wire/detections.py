"""Detections as JSON -> messages: pixels outside, image points inside.

A detection may have all three points, some of them, or only a box. What it lacks is never made up: all three
points become TargetPoints, anything less a TargetDetection.
"""

from collections.abc import Callable, Iterator
from typing import Any, Final

import msgspec

from onboard.geometry.lens import Lens
from onboard.messages import (
    Box,
    CameraDetections,
    DetectedPoint,
    Detection,
    ImageFeature,
    Record,
    TargetDetection,
    TargetImage,
    TargetPoints,
)
from onboard.wire.cameras import CameraInput, Cameras, find
from onboard.wire.document import BadDocumentError, parse
from onboard.wire.points import check_target, lens_of

POINTS: Final = ("center", "left", "right")
LEAST_CONFIDENCE: Final = 0.05  # noise is that of a detection with this confidence at most
BOX_NOISE: Final = 0.05  # of the box's larger side: how well detectors place a box

INSIDE: Final[dict[str, type[Record]]] = {"detections": Detection, "points": DetectedPoint, "box": Box}

Refuse = Callable[[str], None]
_decoder = msgspec.json.Decoder(CameraDetections)


def decode_detections(
    data: bytes, t_recv_ns: int, cameras: Cameras, refuse: Refuse, ignore: Refuse
) -> list[TargetImage]:
    """A message for each detection of one JSON document of CameraDetections.

    A detection that cannot be used costs the others nothing: `refuse` is called with the reason. `ignore` is
    called with each field and each point that is not known. Raises BadDocumentError (see `document.parse`) for a
    document that cannot be used at all.
    """
    document = parse(_decoder, data)
    camera = find(cameras, document.camera)
    lens = camera.lens if document.intrinsics is None else lens_of(document.intrinsics)
    for field in _unknown(msgspec.json.decode(data), CameraDetections, ""):
        ignore(field)
    found: list[TargetImage] = []
    for i, detection in enumerate(document.detections):
        head = {
            "t_ns": document.t_ns,
            "t_recv_ns": t_recv_ns,
            "clock": document.clock,
            "system": 0,
            "component": 0,
            "camera": camera.name,
            "target": detection.target,
            "view": lens.view,
        }
        try:
            found.append(_message(detection, head, camera, lens, f"detections[{i}]"))
        except BadDocumentError as error:
            refuse(str(error))
        for name in detection.points.keys() - POINTS:
            ignore(f"the point `{name}`; the points that are used are {', '.join(POINTS)}")
    return found


def _message(detection: Detection, head: dict[str, Any], camera: CameraInput, lens: Lens, at: str) -> TargetImage:
    """The message of one detection. Raises BadDocumentError."""
    check_target(detection.target, f"{at}.target")
    sigma = camera.sigma_px / _confidence(detection, camera, at) / lens.f_px

    def feature(name: str, p: DetectedPoint) -> ImageFeature:
        own = sigma if p.sigma_px is None else p.sigma_px / lens.f_px
        return ImageFeature(name=name, point=lens.image_point(p.u_px, p.v_px), sigma=own)

    features = tuple(feature(name, detection.points[name]) for name in POINTS if name in detection.points)
    if len(features) == len(POINTS):
        center, left, right = (f.point for f in features)
        sigmas: Any = tuple(f.sigma for f in features)
        return TargetPoints(**head, center=center, left=left, right=right, sigma=sigmas)
    if features:
        return TargetDetection(**head, features=features)
    if detection.box is None:
        raise BadDocumentError(f"expected `points` with some of {', '.join(POINTS)}, or a `box` - at `$.{at}`")
    box = detection.box
    if not (box.width_px > 0 and box.height_px > 0):
        raise BadDocumentError(f"width and height must be positive - at `$.{at}.box`")
    side = max(box.width_px, box.height_px)
    own = max(sigma, BOX_NOISE * side / lens.f_px) if box.sigma_px is None else box.sigma_px / lens.f_px
    middle = ImageFeature(name="box", point=lens.image_point(box.u_px, box.v_px), sigma=own)
    return TargetDetection(**head, features=(middle,), half_width=0.5 * side / lens.f_px)


def _confidence(detection: Detection, camera: CameraInput, at: str) -> float:
    """How sure the detector is, 1 where it does not say. Raises BadDocumentError below the camera's threshold."""
    confidence = detection.confidence
    if confidence is None:
        return 1.0
    if not 0.0 <= confidence <= 1.0:
        raise BadDocumentError(f"a confidence is from 0 to 1 - at `$.{at}.confidence`")
    if confidence < camera.min_confidence:
        least = f"`min_confidence` of camera {camera.name} is {camera.min_confidence:g}"
        raise BadDocumentError(f"it is not confident enough; {least} - at `$.{at}.confidence`")
    return max(confidence, LEAST_CONFIDENCE)


def _unknown(value: Any, kind: Any, at: str) -> Iterator[str]:
    """The fields of a document, however deep, that its record does not have."""
    if isinstance(value, list):
        for item in value:
            yield from _unknown(item, kind, at)
    if not isinstance(value, dict):
        return
    fields = {f.encode_name: f.type for f in msgspec.structs.fields(kind)}
    known = ", ".join(fields)
    yield from (f"the field `{at}{name}`; known: {known}" for name in value.keys() - fields)
    for name, inner in value.items():
        record = INSIDE.get(name)
        if record is None or name not in fields:
            continue
        if name == "points" and isinstance(inner, dict):
            inner = list(inner.values())  # noqa: PLW2901 - by their names, which are any
        yield from _unknown(inner, record, f"{at}{name}.")
