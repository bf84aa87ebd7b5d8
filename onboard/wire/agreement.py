"""Whether the statements of one detection can all be true: where it is, how far, and how large it looks.

A position in millimetres, or with Y up, beside a right box would be believed as far as each goes. Nothing says
which of two is wrong, so the detection is refused, and both are named.
"""

import math
from typing import Final

from onboard.geometry.lens import Lens, LensError
from onboard.messages import Box, Detection, Vec3
from onboard.wire.document import BadDocumentError

NEAR: Final = math.tan(math.radians(3.0))  # focal lengths: so far from a box or its center a position may lie
SIGMAS: Final = 3.0
SMALLEST, LARGEST = 0.2, 2.5  # of the wingspan: the larger side of a box of an aircraft, from wherever it is seen


def check(detection: Detection, lens: Lens, sizes: tuple[float, float], sigma_px: float, at: str) -> None:
    """Raises BadDocumentError, which names both statements. `sizes`: the smallest and the largest wingspan, m."""
    pose, box = detection.pose, detection.box
    position = None if pose is None else pose.position_m
    if position is not None and not (position[2] > 0.0 and all(map(math.isfinite, position))):
        position = None  # it is refused for itself
    if position is not None:
        _check_direction(detection, position, lens, sigma_px, at)
    if box is None:
        return
    if position is not None:
        _check_size(box, math.hypot(*position), lens, sizes, f"{at}.pose.position_m", at)
    if detection.range_m is not None:
        _check_size(box, detection.range_m, lens, sizes, f"{at}.range_m", at)


def _check_direction(detection: Detection, position: Vec3, lens: Lens, sigma_px: float, at: str) -> None:
    right, down, forward = position
    center, box = detection.points.get("center"), detection.box
    seen, name, half = (center, "points.center", 0.0) if center is not None else (box, "box", 1.0)
    if seen is None:
        return
    try:
        (u, v), scale = lens.image_point(seen.u_px, seen.v_px), lens.scale(seen.u_px, seen.v_px)
    except LensError:
        return  # it is refused for itself
    sides = (half * box.width_px, half * box.height_px) if half and box is not None else (0.0, 0.0)
    off = right / forward - u, down / forward - v
    noise = NEAR + SIGMAS * scale * (seen.sigma_px or sigma_px)
    if all(abs(o) <= noise + scale * side for o, side in zip(off, sides, strict=True)):
        return
    angle = math.degrees(math.atan(math.hypot(*off)))
    raise BadDocumentError(
        f"the position is {angle:.0f} degrees from `{name}`; expected right, down, forward in metres"
        f" - at `$.{at}.pose.position_m` and `$.{at}.{name}`"
    )


def _check_size(box: Box, range_m: float, lens: Lens, sizes: tuple[float, float], where: str, at: str) -> None:
    """A box that reaches the image's edge may be cut off: it is at least so large."""
    try:
        scale = lens.scale(box.u_px, box.v_px)
    except LensError:
        return
    size = range_m * scale * max(box.width_px, box.height_px)
    if not math.isfinite(size) or size <= 0.0:
        return
    cut = lens.width_px > 0 and (
        box.u_px - 0.5 * box.width_px <= 1.0
        or box.u_px + 0.5 * box.width_px >= lens.width_px - 1.0
        or box.v_px - 0.5 * box.height_px <= 1.0
        or box.v_px + 0.5 * box.height_px >= lens.height_px - 1.0
    )
    least = 0.0 if cut else SMALLEST * sizes[0]
    if least <= size <= LARGEST * sizes[1]:
        return
    wingspan = f"{sizes[0]:.3g} to {sizes[1]:.3g} m"
    raise BadDocumentError(
        f"at {range_m:g} m the box would be {size:.3g} m large, of a wingspan of {wingspan}; expected metres"
        f" - at `$.{where}` and `$.{at}.box`"
    )
