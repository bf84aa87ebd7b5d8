"""Consistency of one detection's direction, range and size.

A position in millimetres or with Y up contradicts a box. Nothing shows which of the two is wrong, so the detection
is refused and both are named.
"""

import math
from collections.abc import Mapping
from typing import Final

from onboard.geometry.lens import Lens, LensError, Located
from onboard.messages import Box, Detection, Vec3
from onboard.wire.documents import boxes
from onboard.wire.documents.document import BadDocumentError

POSITION_TOLERANCE: Final = math.radians(3.0)  # so far from a box or its center a position may lie
SIGMAS: Final = 3.0
Places = Mapping[str, Located | LensError]  # of a detection's pixels, by name
SMALLEST, LARGEST = 0.2, 2.5  # of the wingspan: the larger side of a box of an aircraft, from wherever it is seen


def check(
    detection: Detection, places: Places, lens: Lens, sizes: tuple[float, float], sigma_px: float, at: str
) -> None:
    """Raise BadDocumentError if two statements disagree; `sizes` bounds the wingspan, m."""
    pose, box = detection.pose, detection.box
    position = None if pose is None else pose.position_m
    if position is not None and not (position[2] > 0.0 and all(map(math.isfinite, position))):
        position = None  # it is refused for itself
    if position is not None:
        _check_direction(detection, position, places, sigma_px, at)
    place = places.get("box")
    ranges = {"pose.position_m": position and math.hypot(*position), "range_m": detection.range_m}
    stated = {name: range_m for name, range_m in ranges.items() if range_m is not None}
    if box is None or not stated or not isinstance(place, Located):
        return  # it is refused for itself
    least = 0.0 if boxes.may_be_cut(box, lens, sigma_px) else SMALLEST * sizes[0]
    angle = place.angle * boxes.larger_px(box)
    for name, range_m in stated.items():
        _check_size(range_m, angle, least, sizes, (f"{at}.{name}", at))


def _check_direction(detection: Detection, position: Vec3, places: Places, sigma_px: float, at: str) -> None:
    has_center = "center" in places
    seen, name = (detection.points["center"], "points.center") if has_center else (detection.box, "box")
    place = places.get("center" if has_center else "box")
    if seen is None or not isinstance(place, Located):
        return  # it is refused for itself
    diagonal_px = math.hypot(seen.width_px, seen.height_px) if isinstance(seen, Box) else 0.0
    (u, v), angle = place.point, place.angle
    right, down, forward = position
    cosine = (forward + right * u + down * v) / math.hypot(*position) / math.hypot(1.0, u, v)
    off = math.acos(max(-1.0, min(cosine, 1.0)))
    if off <= POSITION_TOLERANCE + angle * (SIGMAS * (seen.sigma_px or sigma_px) + diagonal_px):
        return
    raise BadDocumentError(
        f"the position is {math.degrees(off):.0f} degrees from `{name}`; expected right, down, forward in metres"
        f" - at `$.{at}.pose.position_m` and `$.{at}.{name}`"
    )


def _check_size(
    range_m: float, angle: float, least: float, sizes: tuple[float, float], where: tuple[str, str]
) -> None:
    """Check that a box of this angle, rad, is as large as an aircraft at that range.

    `least`, m, is smaller for a box that may be cut off.
    """
    size = range_m * angle
    if not math.isfinite(size) or size <= 0.0:
        return
    if least <= size <= LARGEST * sizes[1]:
        return
    wingspan = f"{sizes[0]:.3g} to {sizes[1]:.3g} m"
    raise BadDocumentError(
        f"at {range_m:g} m the box would be {size:.3g} m large, of a wingspan of {wingspan}; expected metres"
        f" - at `$.{where[0]}` and `$.{where[1]}.box`"
    )
