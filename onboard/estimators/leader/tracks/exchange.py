"""Whether another object has taken the target's place in the images, and what the detector takes it for.

An aircraft moves on from image to image. An object that another one is exchanged for, by a detector, leaps: in
direction, or in apparent size. If from a leap on no image fits the track, one of the two is not the target, and
nothing says which. The new track is then in question until the images leap back, or until the old one would have
been forgotten anyway.

A detector's classes flicker, and its first one may be wrong. So the class of most images of the last seconds is
believed, and the size with it. While two classes come about equally often, nothing is.
"""

import math
from typing import Final, Generic, TypeVar

import numpy as np

from onboard.estimators.leader.image.prepare import Image
from onboard.geometry.units import NS_PER_S
from onboard.messages.causes import Cause, Reason

LONGEST_S: Final = 0.3  # between two images: over longer gaps an aircraft may have moved anywhere
LEAP: Final = math.radians(2.0)  # a direction that changes by more ...
SWIFTEST: Final = math.radians(60.0)  # ... and faster than this, 1/s, leaps; as 10 m/s across at 10 m
RATIO: Final = 1.3  # so does an apparent size that changes by more
SIGMAS: Final = 4.0  # of both sizes' noise, where that is larger
OFTEN: Final = 0.75  # of the images of the believed class: another class that is as frequent leaves it open
LEAPT: Final = Reason(Cause.LEAPT, "the images leapt: another object may have taken its place")
K = TypeVar("K")


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


class Classes(Generic[K]):
    """What the detector takes a target for: `kind`, by the images of the last seconds (`memory_s`, as a time
    constant). A class that is not configured is None: it says nothing against those that are."""

    def __init__(self, memory_s: float) -> None:
        self.kind: K | None = None
        self._memory_s, self._t_ns = memory_s, 0
        self._names: dict[K | None, str] = {}  # the newest of each kind
        self._weights: dict[K | None, float] = {}

    def add(self, kind: K | None, name: str, t_ns: int) -> bool:
        """An image of this time was taken for `name`. Whether another kind is believed from now on: one that comes
        twice as often as the one before."""
        passed_s, self._t_ns = max(t_ns - self._t_ns, 0) / NS_PER_S, max(t_ns, self._t_ns)
        decay = math.exp(-passed_s / self._memory_s)
        self._weights = {each: decay * weight for each, weight in self._weights.items()}
        self._names[kind] = name
        self._weights[kind] = self._weights.get(kind, 0.0) + 1.0
        often = 0.5 if self.kind is None else 2.0
        if kind in (None, self.kind) or self._weights[kind] <= often * self._weights.get(self.kind, 0.0):
            return False
        self.kind = kind
        return True

    @property
    def doubt(self) -> Reason | None:
        """Why it is open what the target is, None if it is not."""
        if self.kind is None:
            return None
        others = {k: w for k, w in self._weights.items() if k not in (None, self.kind)}
        most = max(others, key=others.__getitem__, default=None)
        if most is None or others[most] < OFTEN * self._weights[self.kind]:
            return None
        words = f"the detector takes it now for {self._names[self.kind]}, now for {self._names[most]}"
        return Reason(Cause.CLASS_OPEN, words)


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
