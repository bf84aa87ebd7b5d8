"""Images of one target that show nothing new: a stamp that comes again, or points that stay although we turn."""

from collections import deque
from typing import Final

import numpy as np

from onboard.estimators.leader.image import Image
from onboard.geometry.units import NS_PER_S
from onboard.messages import ImagePoint, TargetImage

STAMPS: Final = 64  # remembered
ROTATION_SIGMAS: Final = 3.0  # of a point: if the camera has rotated by more, its image must have changed


class Repeats:
    """Stamps of the last images, and since when the points are exactly the same."""

    def __init__(self, stale_after_s: float, point_sigma: float) -> None:
        self._stale_after_s, self._point_sigma = stale_after_s, point_sigma
        self._stamps: deque[tuple[int, str]] = deque(maxlen=STAMPS)
        self._unchanged: tuple[tuple[ImagePoint, ...], Image] | None = None  # points, and the first image of them

    @property
    def newest_ns(self) -> int | None:
        """The newest of the stamps."""
        return max((t_ns for t_ns, _ in self._stamps), default=None)

    def is_duplicate(self, message: TargetImage) -> bool:
        """Whether an image of this time and camera has been added."""
        return (message.t_ns, message.camera) in self._stamps

    def add(self, image: Image) -> bool:
        """Remember an image. Whether the camera hangs: its points are exactly the same for too long, although it
        has rotated."""
        message = image.message
        self._stamps.append((message.t_ns, message.camera))
        points = message.image_points
        if self._unchanged is None or self._unchanged[0] != points:
            self._unchanged = points, image
        first = self._unchanged[1]
        long = message.t_ns - first.message.t_ns > self._stale_after_s * NS_PER_S
        rotation = float(np.abs(image.pose.R_cn - first.pose.R_cn).max())
        return long and rotation > ROTATION_SIGMAS * self._point_sigma

    def clear(self) -> None:
        """Forget all images."""
        self._stamps.clear()
        self._unchanged = None
