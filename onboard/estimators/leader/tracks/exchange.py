"""Whether another object has taken the target's place in the images.

An aircraft moves on from image to image. An object that another one is exchanged for, by a detector, leaps: in
direction, or in apparent size. If from a leap on no image fits the track, one of the two is not the target, and
nothing says which. The new track is then in question until the images leap back, or until the old one would have
been forgotten anyway.
"""

import math
from typing import Final

import numpy as np

from onboard.estimators.leader.tracks.image import Image
from onboard.geometry.units import NS_PER_S

LONGEST_S: Final = 0.3  # between two images: over longer gaps an aircraft may have moved anywhere
LEAP: Final = math.radians(2.0)  # a direction that changes by more ...
SWIFTEST: Final = math.radians(60.0)  # ... and faster than this, 1/s, leaps; as 10 m/s across at 10 m
RATIO: Final = 1.3  # so does an apparent size that changes by more
SIGMAS: Final = 4.0  # of both sizes' noise, where that is larger


class Exchange:
    """The newest image that was fused, the first that was not, and until when the track is in question."""

    def __init__(self, forgotten_after_s: float) -> None:
        self._forgotten_after_ns = round(forgotten_after_s * NS_PER_S)
        self._fused: Image | None = None
        self._gated: Image | None = None
        self._before: Image | None = None  # the newest image of what was followed before
        self._until_ns = 0

    def fused(self, image: Image) -> None:
        """A track took an image."""
        self._gated = None
        if self._fused is None or image.message.t_ns > self._fused.message.t_ns:
            self._fused = image

    def gated(self, image: Image) -> None:
        """A track did not take an image."""
        if self._gated is None:
            self._gated = image

    def ended(self) -> None:
        """The track has ended, as no image fits it: the next one is in question if the images had leapt; unless
        they have leapt back."""
        last, first = self._fused, self._gated
        self._fused = self._gated = None
        if last is None or first is None or not leaps(last, first):
            return
        if self._before is not None and _is_as_big(self._before, first):
            self._before, self._until_ns = None, 0
            return
        if last.message.t_ns > self._until_ns:
            self._before = last
        self._until_ns = last.message.t_ns + self._forgotten_after_ns

    def is_in_question(self, t_ns: int) -> bool:
        """Whether what is followed may be another object."""
        return t_ns < self._until_ns

    def clear(self) -> None:
        """Forget all images."""
        self._fused = self._gated = self._before = None
        self._until_ns = 0


def leaps(before: Image, after: Image) -> bool:
    """Whether no aircraft can look so shortly after it looked like that."""
    dt = (after.message.t_ns - before.message.t_ns) / NS_PER_S
    if not 0.0 < dt < LONGEST_S:
        return False
    angle = math.acos(float(np.clip(before.direction_n @ after.direction_n, -1.0, 1.0)))
    return angle > LEAP + SWIFTEST * dt or (
        before.has_extent and after.has_extent and not _is_as_big(before, after)
    )


def _is_as_big(a: Image, b: Image) -> bool:
    a_, b_ = a.measurement, b.measurement
    if a_.has_wing != b_.has_wing:  # a wing and a box cannot be compared
        return True
    noise = SIGMAS * math.hypot(a_.span_sigma / a_.span, b_.span_sigma / b_.span)
    return abs(math.log(a_.span / b_.span)) < max(math.log(RATIO), noise)
