"""Consistency checks that declare the leader lost.

`life_cycle` asks: while any of these holds, the leader is lost.

**Another object**. An aircraft moves on from image to image. An object that another one is exchanged for, by a
detector, leaps: in direction, or in apparent size. If from a leap on no image fits the track, one of the two is
not the target, and nothing says which. The new track is then in question until the old one would have been
forgotten anyway.

**Another class** (`Classes`). A detector's classes flicker, and its first one may be wrong. So the class of most
images of the last seconds is believed, and the size with it. While two classes come about equally often, nothing
is.

**Another way to fly**. Where the images fit none of the hypotheses (`hypotheses.update`), what all of them have in
common is wrong, and their weights say nothing: `assumptions.MEAN_NIS_LIMIT`."""

import math
from typing import Final, Generic, TypeVar

import numpy as np

from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.belief import BeliefFilter
from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.image.prepare import Image
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

# an apparent size that changes by more than MAX_SPAN_RATIO leaps, too
LEAPT: Final = Reason(Cause.LEAPT, "the images leapt: another object may have taken its place")
K = TypeVar("K")
UNEXPECTED: Final = Reason(Cause.UNEXPECTED, "it moves as no hypothesis expects: the range is not known")


class Classes(Generic[K]):
    """The class of a target by its detector.

    `kind`, by the images of the last seconds (`memory_s`, as a time constant). A class that is not configured is
    None: it says nothing against those that are."""

    def __init__(self, memory_s: float) -> None:
        self.kind: K | None = None
        self._memory_s, self._t_ns = memory_s, 0
        self._names: dict[K | None, str] = {}  # the newest of each kind
        self._weights: dict[K | None, float] = {}

    def add(self, kind: K | None, name: str, t_ns: int) -> bool:
        """An image of this time was taken for `name`.

        Whether another kind is believed from now on: one that comes twice as often as the one before."""
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
        if most is None or others[most] < given.CLASS_AMBIGUITY_RATIO * self._weights[self.kind]:
            return None
        words = f"the detector takes it now for {self._names[self.kind]}, now for {self._names[most]}"
        return Reason(Cause.CLASS_OPEN, words)


def leaps(before: Image, after: Image) -> bool:
    """Whether no aircraft can look so shortly after it looked like that."""
    dt = _between(before, after)
    if not 0.0 < dt < given.MAX_IMAGE_INTERVAL_S:
        return False
    has_jumped = _angle(before, after) > given.MIN_BEARING_STEP + given.MAX_BEARING_RATE * dt
    return has_jumped or (before.has_extent and after.has_extent and not _is_as_big(before, after))


def cameras_apart(last: Image, image: Image) -> Reason | None:
    """Why images that do not agree start no track, where they are of two cameras; None where they are of one."""
    names = last.message.camera, image.message.camera
    if names[0] == names[1] or abs(_between(last, image)) > given.MAX_IMAGE_INTERVAL_S:
        return None
    degrees, ratio = math.degrees(_angle(last, image)), image.measurement.span / last.measurement.span
    words = f"cameras {' and '.join(sorted(names))} show it {degrees:.0f} degrees apart"
    return Reason(Cause.CAMERAS_APART, f"{words}, and one {max(ratio, 1.0 / ratio):.1f} times as large")


def _between(before: Image, after: Image) -> float:
    return (after.message.t_ns - before.message.t_ns) / NS_PER_S


def _angle(a: Image, b: Image) -> float:
    return math.acos(float(np.clip(a.direction_n @ b.direction_n, -1.0, 1.0)))


def _is_as_big(a: Image, b: Image) -> bool:
    a_, b_ = a.measurement, b.measurement
    if a_.has_wing != b_.has_wing:  # a wing and a box cannot be compared
        return True
    noise = given.SIZE_JUMP_SIGMAS * math.hypot(a_.span_sigma / a_.span, b_.span_sigma / b_.span)
    return abs(math.log(a_.span / b_.span)) < max(math.log(given.MAX_SPAN_RATIO), noise)


class Checks:
    """Consistency checks of one track, by its images and by what was published."""

    def __init__(self, config: Config) -> None:
        self._memory_s = 0.5 * config.reset_timeout_s
        self._forgotten_after_ns = round(config.reset_timeout_s * NS_PER_S)
        self.classes = Classes[BeliefFilter](self._memory_s)
        self._last: Image | None = None  # the newest that was fused
        self._gated: Image | None = None  # the first that was not
        self.leapt_until_ns = 0  # until then what is followed may be another object

    def fused(self, image: Image) -> None:
        """A track took an image."""
        self._gated = None
        t_ns = image.message.t_ns
        if self._last is None or t_ns > self._last.message.t_ns:
            self._last = image

    def gated(self, image: Image) -> None:
        """A track did not take an image."""
        self._gated = self._gated or image

    def ended(self, image: Image) -> bool:
        """The track has ended, as no image fits it, this one neither.

        Whether the images had leapt: the next track is then in question."""
        last, first = self._last, self._gated or image
        self._last = self._gated = None
        if last is None or not leaps(last, first):
            return False
        self.leapt_until_ns = last.message.t_ns + self._forgotten_after_ns
        return True

    def clear(self) -> None:
        """Forget all images and all times."""
        self._last = self._gated = None
        self.leapt_until_ns = 0

    def judge(self, t_ns: int, noise: NoiseScale, *, is_misfit: bool) -> tuple[Reason | None, str]:
        """Return what contradicts a belief, None if nothing does, and a finding to report, "" if none."""
        doubt = (
            (LEAPT if t_ns < self.leapt_until_ns else None)
            or self.classes.doubt
            or (noise.contradiction if noise.beyond else None)
            or (UNEXPECTED if is_misfit else None)
        )
        return doubt, noise.finding
