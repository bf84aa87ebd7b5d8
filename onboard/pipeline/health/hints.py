"""What images show of a wrong set-up, though each of them can be used. It is reported beside the refusals.

Nothing in a pixel shows of how large an image it is. Pixels of an image that was halved lie in the upper left
quarter of the image that is configured, all of them, which those of a whole image hardly do for long. Where the
leader stays in that quarter anyway, nothing shows the difference.
"""

import math
from collections.abc import Callable
from typing import Final

from onboard.messages import DOUBT, TargetImage
from onboard.messages.causes import Cause, Reason

IMAGES: Final = 500  # in a row, of one camera
SPAN_NS: Final = 20_000_000_000  # that they last at least
MOST: Final = 32  # cameras
UNUSED: Final = Reason(
    Cause.RANGE_UNUSED,
    f"{DOUBT}`range_m` of its detections is not used: set `detections = true` in [estimator.leader.range], or "
    "leave it out",
)
QUARTER: Final = Reason(
    Cause.QUARTER,
    f"{DOUBT}the points of all its images are in the upper left quarter of the configured image: are they pixels "
    "of an image of half the size? Then set `width_px` and `height_px`, or send `intrinsics`",
)


class Hints:
    """`add(source, reason, t_recv_ns)` takes what is found. `takes_ranges`: ranges of detections are used."""

    def __init__(self, add: Callable[[str, Reason, int], None], *, takes_ranges: bool) -> None:
        self._add, self._takes_ranges = add, takes_ranges
        self._quarters: dict[str, tuple[int, int]] = {}  # by camera: images in a row, and the first one's arrival

    def see(self, image: TargetImage) -> None:
        """Take an image that goes further."""
        source = f"camera {image.camera}"
        if image.range is not None and not self._takes_ranges:
            self._add(source, UNUSED, image.t_recv_ns)
        if image.doubt:
            self._add(source, Reason(image.doubt.cause, DOUBT + image.doubt.words), image.t_recv_ns)
        left, upper, right, lower = image.view or (0.0, 0.0, 0.0, 0.0)
        middle = _between(left, right), _between(upper, lower)
        count, since_ns = self._quarters.get(image.camera, (0, image.t_recv_ns))
        if any(u >= middle[0] or v >= middle[1] for u, v in image.image_points):
            self._quarters.pop(image.camera, None)
        elif count or len(self._quarters) < MOST:
            self._quarters[image.camera] = count + 1, since_ns
            if count >= IMAGES and image.t_recv_ns - since_ns > SPAN_NS:
                self._add(source, QUARTER, image.t_recv_ns)


def _between(a: float, b: float) -> float:
    """The image coordinate in the middle of two, by their angles: one edge of a wide image may be very far."""
    return math.tan(0.5 * (math.atan(a) + math.atan(b)))
