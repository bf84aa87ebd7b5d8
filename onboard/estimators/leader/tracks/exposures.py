"""How many aircraft a camera sees at once.

An image without an id that fits no track is either an outlier or of another aircraft. If the camera sees no more
aircraft at once than there are tracks, it is an outlier. Without this, outliers would begin a second track of the
same aircraft, which then takes half of its images. So would a detector that draws two boxes about one aircraft:
images that lie half upon each other count as one.
"""

import math
from typing import Final, NamedTuple

from onboard.geometry.units import NS_PER_S
from onboard.messages import ImagePoint, TargetDetection, TargetImage

REMEMBERED: Final = 128  # exposures: a second of four cameras


class Disc(NamedTuple):
    """Where an image is, and how far it reaches, in focal lengths."""

    middle: ImagePoint
    radius: float

    def covers(self, other: "Disc") -> bool:
        """Whether two images lie half upon each other."""
        return self.middle == other.middle or math.dist(self.middle, other.middle) < max(self.radius, other.radius)


def disc_of(message: TargetImage) -> Disc:
    """Of an image; without a radius where it shows one point alone."""
    first, *others = message.image_points
    radius = max([math.dist(first, point) for point in others], default=0.0)
    if isinstance(message, TargetDetection):
        radius = max(radius, message.half_width or 0.0)
    return Disc(first, radius)


class Exposures:
    """The images of the last exposures, by camera and time; of one exposure at most one more than `targets`."""

    def __init__(self, targets: int) -> None:
        self._most = targets + 1
        self._images: dict[tuple[str, int], list[Disc]] = {}

    def add(self, message: TargetImage) -> None:
        """Remember an image."""
        disc, images = disc_of(message), self._images.setdefault((message.camera, message.t_ns), [])
        if len(images) < self._most and not any(map(disc.covers, images)):
            images.append(disc)
        while len(self._images) > REMEMBERED:
            del self._images[next(iter(self._images))]

    def aircraft(self, message: TargetImage) -> int:
        """The largest number of different images that the camera of `message` took at one time within a second of
        it."""
        sizes = (
            len(images)
            for (camera, t_ns), images in self._images.items()
            if camera == message.camera and abs(message.t_ns - t_ns) <= NS_PER_S
        )
        return max(sizes, default=0)
