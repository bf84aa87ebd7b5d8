"""Detections as JSON -> messages: pixels outside, image points inside.

A detection may have all three points of the wing, some of them, further points of its class, only a box, or a
pose. What it lacks is never made up: all three points become TargetPoints, anything less a TargetDetection.
Where no point is named, the position of a pose is the center.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, Final

import msgspec
import numpy as np

from onboard.geometry.lens import Lens, LensError, Located
from onboard.messages import (
    Box,
    CameraDetections,
    DetectedPoint,
    DetectedPose,
    Detection,
    Exposure,
    ImageFeature,
    MountAttitude,
    Record,
    RelativePose,
    TargetDetection,
    TargetImage,
    TargetPoints,
)
from onboard.messages.causes import Cause, Reason
from onboard.messages.target import WING_POINTS
from onboard.messages.text import plain
from onboard.wire.documents import agreement, boxes
from onboard.wire.documents.agreement import Places
from onboard.wire.documents.cameras import CameraInput, Cameras, find
from onboard.wire.documents.document import BadDocumentError, Refuse, parse_tree
from onboard.wire.documents.points import check_pixels, check_target, doubt_of, lens_of
from onboard.wire.documents.poses import relative_pose

MIN_CONFIDENCE: Final = 0.05  # below it, the noise grows no further
MAX_RANGE_M: Final = 1e5
# Of one image: each without an id is compared with each track, and more cost more time than an image has.
MAX_NAMED, MAX_UNNAMED = 100, 12
UNSEEN: Final = (0.0, 0.0)  # pixels of a keypoint that Ultralytics and others do not see; no wingtip is just there
BOX: Final = "box"  # the name of its middle
Ignore = Callable[[str], None]

NESTED_RECORDS: Final[dict[str, type[Record]]] = {
    "detections": Detection,
    "points": DetectedPoint,
    "box": Box,
    "pose": DetectedPose,
    "attitude": MountAttitude,
}


def decode_detections(
    data: bytes, t_recv_ns: int, cameras: Cameras, refuse: Refuse, ignore: Ignore
) -> Exposure | None:
    """Decode one JSON document of CameraDetections; None if no detection is usable.

    `refuse` receives the reason for each unusable detection, `ignore` each unknown field and point. Raises
    BadDocumentError (see `document.parse`) for an unusable document.
    """
    document, numbers, tree = parse_tree(CameraDetections, data, refuse)
    mount = document.attitude
    if mount is not None and not 0.5 < math.hypot(*mount.q) < 2.0:
        raise BadDocumentError("expected a quaternion w, x, y, z of length 1 - at `$.attitude.q`")
    for field in _unknown(tree, CameraDetections, ""):
        ignore(field)
    camera = find(cameras, document.camera)
    lens = camera.lens if document.intrinsics is None else lens_of(document.intrinsics)
    return exposure_of(document, t_recv_ns, camera, lens, refuse, ignore, numbers)


def exposure_of(
    document: CameraDetections,
    t_recv_ns: int,
    camera: CameraInput,
    lens: Lens,
    refuse: Refuse,
    ignore: Ignore,
    numbers: Sequence[int] | None = None,
) -> Exposure | None:
    """The exposure of a document with pixels of `lens`, or None; see `decode_detections`.

    `numbers` are the detections' indices in the document as sent, if some were left out.
    """
    found: list[TargetImage] = []
    kept = _bounded(document.detections, refuse)
    shown = [_pixels(detection, camera) for _, detection in kept]
    located = iter(lens.locate([(p.u_px, p.v_px) for pixels in shown for p in pixels.values()]))
    for (k, detection), pixels in zip(kept, shown, strict=True):
        i = k if numbers is None else numbers[k]
        places = {name: next(located) for name in pixels}
        head = {
            "t_ns": document.t_ns,
            "t_recv_ns": t_recv_ns,
            "clock": document.clock,
            "system": 0,
            "component": 0,
            "camera": camera.name,
            "target": detection.target,
            "class_name": detection.class_name and plain(detection.class_name.strip()),
            "view": lens.view,
            "doubt": doubt_of(lens) if lens.note else None,
            "mount": document.attitude,
            "range": detection.range_m,
            "range_sigma": detection.range_sigma_m,
        }
        if any((p.u_px, p.v_px) == UNSEEN for p in detection.points.values()):
            ignore("points at exactly (0, 0): a keypoint model writes that for one that it does not see")
        try:
            found.append(_message(detection, head, camera, lens, places, f"detections[{i}]"))
        except BadDocumentError as error:
            refuse(error.why)
        for name in detection.points.keys() - camera.points:
            ignore(f"the point `{name}`; the points that are used are {', '.join(camera.points)}")
    return Exposure.of(*found) if found else None


def _bounded(detections: Sequence[Detection], refuse: Refuse) -> Sequence[tuple[int, Detection]]:
    """Return the most confident detections of an image, with their indices."""
    named, unnamed = (
        [each for each in enumerate(detections) if bool(each[1].target) == has_name] for has_name in (True, False)
    )
    if len(named) <= MAX_NAMED and len(unnamed) <= MAX_UNNAMED:
        return [*enumerate(detections)]
    words = f"{len(detections)} detections in one image: the {MAX_UNNAMED} most confident ones are used"
    refuse(Reason(Cause.RATIONED, f"{words}, and {MAX_NAMED} that have a `target`; send fewer"))
    unnamed.sort(key=lambda each: -1.0 if each[1].confidence is None else -each[1].confidence)
    return sorted([*named[:MAX_NAMED], *unnamed[:MAX_UNNAMED]], key=lambda each: each[0])


def _pixels(detection: Detection, camera: CameraInput) -> dict[str, DetectedPoint | Box]:
    """The points that are seen and used, in the camera's order, and the middle of the box."""
    points, box = detection.points, detection.box
    known = ((name, points[name]) for name in camera.points if name in points)
    seen: dict[str, DetectedPoint | Box] = {name: p for name, p in known if (p.u_px, p.v_px) != UNSEEN}
    return seen if box is None else {**seen, BOX: box}


def _message(
    detection: Detection, head: dict[str, Any], camera: CameraInput, lens: Lens, places: Places, at: str
) -> TargetImage:
    """The message of one detection, whose pixels are at these places. Raises BadDocumentError."""
    check_target(detection.target, f"{at}.target")
    name = head["class_name"]
    if camera.classes and name not in ("", *camera.classes):
        followed = f"`classes` of camera {camera.name} are {', '.join(camera.classes)}"
        raise BadDocumentError(f"`{name}` is not followed; {followed} - at `$.{at}.class`", Cause.UNKNOWN_CLASS)
    _check_range(detection, at)
    sigma_px = camera.sigma_px / _confidence(detection, camera, at)
    if detection.pose is not None or detection.range_m is not None:
        agreement.check(detection, places, lens, camera.sizes, sigma_px, at)
    points, box = detection.points, detection.box
    check_pixels(_coordinates(detection), at)
    if detection.pose is not None:
        head["pose"] = relative_pose(detection.pose, sigma_px / lens.f_px, f"{at}.pose")
    features = tuple(
        _feature(name, _located(place, f"{at}.points.{name}"), points[name].sigma_px, sigma_px)
        for name, place in places.items()
        if name != BOX
    )
    if places.keys() >= set(WING_POINTS):
        (center, left, right), others = features[:3], features[3:]
        return TargetPoints(
            **head,
            center=center.point,
            left=left.point,
            right=right.point,
            sigma=(center.sigma, left.sigma, right.sigma),
            others=others,
        )
    if not features and detection.pose is not None:
        features = _center(head["pose"])
    if box is None and not features:
        known = ", ".join(camera.points)
        raise BadDocumentError(
            f"expected `points` with some of {known}, a `box`, or a `pose` with `position_m` - at `$.{at}`"
        )
    if box is None:
        return TargetDetection(**head, features=features)
    if not (box.width_px > 0 and box.height_px > 0):
        raise BadDocumentError(f"width and height must be positive - at `$.{at}.box`")
    place = _located(places[BOX], f"{at}.box")
    middle = _feature(BOX, place, box.sigma_px, boxes.noise_px(box, sigma_px))
    return TargetDetection(
        **head,
        features=(*features, middle),
        half_width=0.5 * place.scale * boxes.larger_px(box),
        sides=None if boxes.may_be_cut(box, lens, sigma_px) else boxes.sides(box, lens),
    )


def _coordinates(detection: Detection) -> list[float]:
    """All pixel coordinates of a detection that are seen, and the size of its box."""
    seen = [(p.u_px, p.v_px) for p in detection.points.values() if (p.u_px, p.v_px) != UNSEEN]
    box = detection.box
    boxes = () if box is None else ((box.u_px, box.v_px), (box.width_px, box.height_px))
    return [x for pair in (*seen, *boxes) for x in pair]


def _located(place: Located | LensError, at: str) -> Located:
    """Raises BadDocumentError for a pixel that the lens does not describe."""
    if isinstance(place, LensError):
        raise BadDocumentError(f"{place} - at `$.{at}`") from place
    return place


def _feature(name: str, place: Located, own_px: float | None, sigma_px: float) -> ImageFeature:
    """A pixel as an image point; `sigma_px` where it has no sigma of its own."""
    own_px = sigma_px if own_px is None else own_px
    return ImageFeature(name=name, point=place.point, sigma=own_px * place.scale)


def _center(pose: RelativePose) -> tuple[ImageFeature, ...]:
    """The center where a pose has it, with the noise of the coordinate that is known worst."""
    if pose.r_CL_c is None or pose.r_covariance is None:
        return ()
    forward, right, down = pose.r_CL_c
    point = right / forward, down / forward
    J = np.array([[-point[0], 1.0, 0.0], [-point[1], 0.0, 1.0]]) / forward
    sigma = math.sqrt(float(np.diag(J @ np.array(pose.r_covariance) @ J.T).max()))
    return (ImageFeature(name="center", point=point, sigma=sigma),)


def _check_range(detection: Detection, at: str) -> None:
    """Raise BadDocumentError for a range that is not positive or too large."""
    for name, value in (("range_m", detection.range_m), ("range_sigma_m", detection.range_sigma_m)):
        if value is not None and not 0.0 < value < MAX_RANGE_M:
            raise BadDocumentError(f"expected metres above 0 and below {MAX_RANGE_M:g} - at `$.{at}.{name}`")
    if detection.range_m is None and detection.range_sigma_m is not None:
        raise BadDocumentError(f"a sigma without a range; send `range_m` too - at `$.{at}.range_sigma_m`")


def _confidence(detection: Detection, camera: CameraInput, at: str) -> float:
    """The detector's confidence, 1 if not stated. Raises BadDocumentError below the threshold."""
    confidence = detection.confidence
    if confidence is None:
        return 1.0
    if not 0.0 <= confidence <= 1.0:
        raise BadDocumentError(f"a confidence is from 0 to 1 - at `$.{at}.confidence`")
    if confidence < camera.min_confidence:
        least = f"`min_confidence` of camera {camera.name} is {camera.min_confidence:g}"
        raise BadDocumentError(f"it is not confident enough; {least} - at `$.{at}.confidence`")
    return max(confidence, MIN_CONFIDENCE)


@cache
def _fields(kind: type[Record]) -> tuple[str, ...]:
    """The names of a record's fields in a document, in order."""
    return tuple(field.encode_name for field in msgspec.structs.fields(kind))


def _unknown(value: Any, kind: type[Record], at: str) -> Iterator[str]:
    """The fields of a document, however deep, that its record does not have."""
    if isinstance(value, list):
        for item in value:
            yield from _unknown(item, kind, at)
    if not isinstance(value, dict):
        return
    fields = _fields(kind)
    for name in value.keys() - set(fields):
        yield f"the field `{at}{name}`; known: {', '.join(fields)}"
    for name, inner in value.items():
        record = NESTED_RECORDS.get(name)
        if record is None or name not in fields:
            continue
        if name == "points" and isinstance(inner, dict):
            inner = list(inner.values())  # noqa: PLW2901 - by their names, which are any
        yield from _unknown(inner, record, f"{at}{name}.")
