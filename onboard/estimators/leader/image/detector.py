"""A detector and its camera, judged by their images.

How noisy the points are, and whether the camera hangs.

The innovations of the direction say how far images are from what was predicted. Where half of them are farther off
for a whole window than the configured noise allows, the noise is larger than configured, and is taken for so much
larger. Up to `MAX_NOISE_SCALE` times: images that fit worse come of something else, and nothing is valid with
them. A median, so that neither outliers nor a short manoeuvre count; the direction alone, as the wing misleads
where the heading is not on the course.

A noise that is a little larger is told from a leader that moves a little otherwise by the next image. What an
image leaves, after the belief has followed it, and what the next one is off, are of one course of the leader: they
differ by the noise of both, while a misfit is in both. So the scale follows their differences, half of the way.

What was learnt is part of a track's state, so it is rewound with it: an image counts by its exposure, with its
final pose, however late it arrives.

Images that show nothing new are a stamp that comes again, or points that stay although we turn. A camera that
hangs repeats its image; a detector may add a little noise of its own. No detector is so quiet that its points stay
within a third of their standard deviation, image after image, while our rotation would have moved them by several,
unless the target turns with us to the hundredth of a degree."""

import math
from collections import deque
from statistics import median
from typing import NamedTuple

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.image.prepare import Image
from onboard.messages import ImagePoint, TargetDetection, TargetPoints, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S


class Shown(NamedTuple):
    """When an image was taken, by which camera, and its own variance of each coordinate of the direction."""

    t_ns: int
    camera: str
    variance: float


class Left(NamedTuple):
    """Residual of an image's direction after the update."""

    t_ns: int
    camera: str
    right: float
    down: float


class NoiseScale(NamedTuple):
    """Learnt noise of a detector.

    `scale` times the configured standard deviations are used; the median NIS where even the largest scale does not
    explain it, else 0; the NIS of the images since the last window, and that of their differences; and what the
    last one left."""

    scale: float = 1.0
    beyond: float = 0.0
    window: tuple[float, ...] = ()
    differences: tuple[float, ...] = ()
    left: Left | None = None

    def restarted(self) -> "NoiseScale":
        """For another track of the same detector."""
        return self._replace(beyond=0.0)

    def after(self, innovation: Array, covariance: Array, shown: Shown | None = None) -> "NoiseScale":
        """After an image was compared with its prediction.

        Innovation (m,), covariance (m, m), the direction first. `shown`: None where its own noise is not white."""
        e, f = innovation[:2].tolist()
        (a, b), (_, d) = covariance[:2, :2].tolist()
        by_e, by_f = (d * e - b * f) / (a * d - b * b), (a * f - b * e) / (a * d - b * b)
        nis = e * by_e + f * by_f
        if nis * self.scale**2 > given.OUTLIER_NIS * given.MAX_NOISE_SCALE**2:
            return self  # of something else: an outlier, which the gate stops
        window = (*self.window, nis)
        differences, left, before = self.differences, None, self.left
        if shown is not None:
            t_ns, camera, variance = shown
            left = Left(t_ns, camera, variance * by_e, variance * by_f)
            is_next = before is not None and 0 < t_ns - before.t_ns < given.MAX_SUCCESSIVE_INTERVAL_NS
            if before is not None and is_next and before.camera == camera:
                square = (e - before.right) ** 2 + (f - before.down) ** 2
                differences = (*differences, square / (2.0 * variance))
        if len(window) < given.NOISE_WINDOW:
            return NoiseScale(self.scale, self.beyond, window, differences, left)
        found, scale, is_told = median(window), self.scale, len(differences) > given.NOISE_WINDOW // 2
        ratio = found / given.MEDIAN_NIS
        beyond = found if ratio > given.NOISE_RATIO_LIMIT and scale >= given.MAX_NOISE_SCALE else 0.0
        by_differences = median(differences) / given.MEDIAN_NIS if is_told else ratio
        if ratio > given.NOISE_RATIO_LIMIT:
            scale = min(scale * math.sqrt(ratio), given.MAX_NOISE_SCALE)
        elif scale > 1.0 or (is_told and by_differences > 1.0):
            # Half the way: one window's evidence.
            scale = min(max(scale * by_differences**0.25, 1.0), given.MAX_NOISE_SCALE)
        return NoiseScale(scale, beyond, left=left)

    @property
    def finding(self) -> str:
        """Return what to report of the noise, "" if nothing."""
        words = "the images fit worse than the configured noise explains"
        return words if self.scale > given.REPORTED_NOISE_SCALE else ""

    @property
    def contradiction(self) -> Reason | None:
        """Why no estimate is valid, None if it may be."""
        if not self.beyond:
            return None
        words = f"NIS {self.beyond:.0f} of 1.4 at {given.MAX_NOISE_SCALE:g} times the configured noise"
        return Reason(Cause.NOISE, f"the images do not fit: {words}")


class Repeats:
    """Stamps of the last images, and since when the points have stayed."""

    def __init__(self, stale_after_s: float, point_sigma: float) -> None:
        self._stale_after_s, self._point_sigma = stale_after_s, point_sigma
        self._stamps: deque[tuple[int, str]] = deque(maxlen=given.STAMP_COUNT)
        # points of each camera, their first image, and how many have shown them since
        self._unchanged: dict[str, tuple[tuple[ImagePoint, ...], Image, int]] = {}

    @property
    def newest_ns(self) -> int | None:
        """The newest of the stamps."""
        return max((t_ns for t_ns, _ in self._stamps), default=None)

    def judge(self, image: Image) -> Verdict | None:
        """Remember an image.

        DUPLICATE if one of this time and camera has been added, STALE if the camera hangs: its points have stayed
        for too long, although it has rotated; else None."""
        message = image.message
        stamp = message.t_ns, message.camera
        if stamp in self._stamps:
            return Verdict.DUPLICATE
        self._stamps.append(stamp)
        points = message.image_points
        # the smallest deviation of a point, as stated or as configured: a simulated camera may have next to
        # none, and then no formation is too steady
        stated: tuple[float, ...] = ()
        if isinstance(message, TargetPoints):
            stated = message.sigma or ()
        elif isinstance(message, TargetDetection):
            stated = tuple(feature.sigma for feature in message.features)
        sigma = min(stated, default=self._point_sigma)
        shown, first, count = self._unchanged.get(message.camera, (points, image, 0))
        if not _are_unchanged(shown, points, given.UNCHANGED_POINT_SIGMAS * sigma):
            shown, first, count = points, image, 0
        self._unchanged[message.camera] = shown, first, count + 1
        age_ns = message.t_ns - first.message.t_ns
        if count + 1 < given.MIN_UNCHANGED_IMAGES or age_ns <= self._stale_after_s * NS_PER_S:
            return None
        return Verdict.STALE if _turned_by(points[0], first, image) > given.ROTATION_SIGMAS * sigma else None

    def clear(self) -> None:
        """Forget all images."""
        self._stamps.clear()
        self._unchanged.clear()


def _turned_by(point: ImagePoint, first: Image, now: Image) -> float:
    """Return how far our rotation moves a far point between two images, in focal lengths."""
    x, y, z = (now.pose.R_cn @ first.pose.R_cn.T @ (1.0, *point)).tolist()
    return math.dist(point, (y / x, z / x)) if x > 0.0 else math.inf


def _are_unchanged(before: tuple[ImagePoint, ...], now: tuple[ImagePoint, ...], within: float) -> bool:
    """Whether all coordinates change by less than `within`, in focal lengths."""
    pairs = zip(before, now, strict=False)
    return len(before) == len(now) and all(abs(a - c) < within and abs(b - d) < within for (a, b), (c, d) in pairs)
