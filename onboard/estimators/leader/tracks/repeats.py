"""Images of one target that show nothing new: a stamp that comes again, or points that stay although we turn.

A camera that hangs repeats its image; a detector may add a little noise of its own. No detector is so quiet that
its points stay within a third of their standard deviation while we turn, unless the target turns with us to the
hundredth of a degree.
"""

from collections import deque
from typing import Final

import numpy as np

from onboard.estimators.leader.tracks.image import Image
from onboard.geometry.units import NS_PER_S
from onboard.messages import ImagePoint, TargetDetection, TargetImage, TargetPoints

STAMPS: Final = 64  # remembered
QUIET: Final = 0.35  # of a point's standard deviation: points that change by less stay
ROTATION_SIGMAS: Final = 3.0  # of a point: if the camera has rotated by more, its image must have changed


class Repeats:
    """Stamps of the last images, and since when the points have stayed."""

    def __init__(self, stale_after_s: float, point_sigma: float) -> None:
        self._stale_after_s, self._point_sigma = stale_after_s, point_sigma
        self._stamps: deque[tuple[int, str]] = deque(maxlen=STAMPS)
        # points of each camera, and their first image
        self._unchanged: dict[str, tuple[tuple[ImagePoint, ...], Image]] = {}

    @property
    def newest_ns(self) -> int | None:
        """The newest of the stamps."""
        return max((t_ns for t_ns, _ in self._stamps), default=None)

    def is_duplicate(self, message: TargetImage) -> bool:
        """Whether an image of this time and camera has been added."""
        return (message.t_ns, message.camera) in self._stamps

    def add(self, image: Image) -> bool:
        """Remember an image. Whether the camera hangs: its points have stayed for too long, although it has
        rotated."""
        message = image.message
        self._stamps.append((message.t_ns, message.camera))
        points = message.image_points
        before = self._unchanged.get(message.camera)
        if before is None or not _stay(before[0], points, QUIET * self._sigma(message)):
            self._unchanged[message.camera] = before = points, image
        first = before[1]
        if message.t_ns - first.message.t_ns <= self._stale_after_s * NS_PER_S:
            return False
        rotation = float(np.abs(image.pose.R_cn - first.pose.R_cn).max())
        return rotation > ROTATION_SIGMAS * self._point_sigma

    def _sigma(self, message: TargetImage) -> float:
        """The smallest standard deviation of a point, as stated or as configured: a simulated camera may have next
        to none, and then no formation is too steady."""
        stated: tuple[float, ...] = ()
        if isinstance(message, TargetPoints):
            stated = message.sigma or ()
        elif isinstance(message, TargetDetection):
            stated = tuple(feature.sigma for feature in message.features)
        return min(stated, default=self._point_sigma)

    def clear(self) -> None:
        """Forget all images."""
        self._stamps.clear()
        self._unchanged.clear()


def _stay(before: tuple[ImagePoint, ...], now: tuple[ImagePoint, ...], within: float) -> bool:
    """Whether all coordinates change by less than `within`, in focal lengths."""
    pairs = zip(before, now, strict=False)
    return len(before) == len(now) and all(abs(a - c) < within and abs(b - d) < within for (a, b), (c, d) in pairs)
