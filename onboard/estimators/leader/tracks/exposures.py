"""How many aircraft a camera sees at once.

An image without an id that fits no track is either an outlier or of another aircraft. If the camera sees no more
aircraft at once than there are tracks, it is an outlier. Without this, outliers would begin a second track of the
same aircraft, which then takes half of its images.
"""

from typing import Final

from onboard.geometry.units import NS_PER_S
from onboard.messages import ImagePoint, TargetImage

REMEMBERED: Final = 128  # exposures: a second of four cameras


class Exposures:
    """The images of the last exposures, by camera and time; of one exposure at most one more than `targets`."""

    def __init__(self, targets: int) -> None:
        self._most = targets + 1
        self._images: dict[tuple[str, int], set[ImagePoint]] = {}

    def add(self, message: TargetImage) -> None:
        """Remember an image."""
        images = self._images.setdefault((message.camera, message.t_ns), set())
        if len(images) < self._most:
            images.add(message.image_points[0])
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
