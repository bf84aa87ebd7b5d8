"""What a detection measures that has not all three points of the wing, or has more.

- Both wingtips without the center: the wing as ever. The center is near the wing's middle, but not on it, unless
  `center_on_wing` says so: its direction is that of the middle, with noise in proportion to the wing.
- The center, one wingtip, another point, or a box: a direction. A wingtip is half a wing off the center, the
  middle of a box may be a tenth of the box off, and that of a box which the image's edge may cut off half a wing.
  Such an offset is a bias, which images do not average out: it counts `BIAS_COUNTS` times.
- Further points of the class, and, where the wing was not seen, the sides of a box: see `shape`.
- A pose: see `pose`. Where nothing else shows the size, its range is the range.

A direction alone starts no track: it says nothing of the range.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.estimators.leader.filters.belief import BeliefFilter
from onboard.estimators.leader.filters.measurement import Measurement
from onboard.estimators.leader.pose import measured_pose
from onboard.estimators.leader.shape import BOX_SHARE, MIDDLE_AND_SIZE, of_box, of_points
from onboard.filters.belief import Update
from onboard.messages import (
    ImageFeature,
    ImagePoint,
    RelativePose,
    Sides,
    TargetDetection,
    TargetImage,
    TargetPoints,
    Vec3,
)

UNKNOWN: Final = 100.0  # rad: the noise of what is not measured. A minute of images with it says nothing
BIAS_COUNTS: Final = 4.0  # times: a filter averages some sixteen images
OFF_WING: Final = 0.1  # of the wing: the center from the wing's middle, where nothing is known of it
ON_WING: Final = 0.02  # the same with `center_on_wing`, which allows 1 %; the nearer half of a wing looks longer
OFF_BOX: Final = 0.1  # of the box's side: the center from the box's middle
TIPS: Final = 0.3  # of the wing: noise of tips that are to say only which one is left ...
SIDES: Final = 3.0  # ... and of their own at least
FAKE: Final = 1e-3  # focal lengths: half the wing of an image that shows none; its noise is UNKNOWN


class Features(NamedTuple):
    """What an image shows of an aircraft, in focal lengths."""

    points: tuple[ImagePoint, ImagePoint, ImagePoint]  # center, left and right
    sigmas: Vec3  # theirs
    offset: float = 0.0  # how far off the center may be by a bias
    has_center: bool = True  # it was seen, and does not stand for what was not
    has_wing: bool = True
    named: tuple[ImageFeature, ...] = ()  # all points that have names
    box: tuple[Sides, float] | None = None  # and the noise of each side, in shares of the larger one
    pose: RelativePose | None = None  # the detector's own

    def noisier(self, scale: float) -> "Features":
        """The same by a detector whose points are this many times as noisy."""
        if scale == 1.0:
            return self

        def noisy(feature: ImageFeature) -> ImageFeature:
            return replace(feature, sigma=scale * feature.sigma)

        a, b, c = self.sigmas
        box = None if self.box is None else (self.box[0], scale * self.box[1])
        named = tuple(map(noisy, self.named))
        return self._replace(sigmas=(scale * a, scale * b, scale * c), named=named, box=box)

    @property
    def named_points(self) -> tuple[ImagePoint, ...]:
        """Where the named points are."""
        return tuple(feature.point for feature in self.named)


def features_of(message: TargetImage, camera_sigma: float, *, center_on_wing: bool, half_wing: float) -> Features:
    """What a message shows. `camera_sigma`: of a point without its own; `half_wing`: half the wing as it appears
    at most, where one wingtip is all that is seen. All in focal lengths."""
    if isinstance(message, TargetPoints):
        points = message.center, message.left, message.right
        sigmas = message.sigma or (camera_sigma,) * 3
        named = (*message.others, *_tips(points[1], points[2], sigmas[1:]))
        return Features(points, sigmas, named=named, pose=message.pose)
    if not isinstance(message, TargetDetection):
        raise TypeError(f"{type(message).__name__} is not an image of a target")
    features = {f.name: f for f in message.features}
    if "center" not in features and "left" in features and "right" in features:
        left, right = features["left"], features["right"]
        (a, b), (c, d) = left.point, right.point
        sigma = 0.5 * math.hypot(left.sigma, right.sigma)
        off = ON_WING if center_on_wing else OFF_WING
        points = ((a + c) / 2, (b + d) / 2), left.point, right.point
        offset = off * math.dist(*points[1:]) * _angle(points[0])
        sigmas = sigma, left.sigma, right.sigma
        others = tuple(f for name, f in features.items() if name not in ("left", "right"))
        tips = _tips(left.point, right.point, (left.sigma, right.sigma))
        return Features(points, sigmas, offset, has_center=False, named=(*others, *tips), pose=message.pose)
    one, half_width = features.get("center", message.features[0]), message.half_width or 0.0
    of_whole_box = 2.0 * OFF_BOX * half_width * _angle(one.point)
    of_box = of_whole_box if message.sides else max(of_whole_box, half_wing)
    offset = {"center": 0.0, "box": of_box}.get(one.name, half_wing)
    u, v = one.point
    points = one.point, (u - FAKE, v), (u + FAKE, v)
    has_center = one.name == "center"
    box = None
    if message.sides and half_width:
        box = message.sides, max(features["box"].sigma / (2.0 * half_width), BOX_SHARE)
    return Features(points, (one.sigma,) * 3, offset, has_center, False, message.features, box, message.pose)


def _angle(point: ImagePoint) -> float:
    """Radians per focal length about a point, the geometric mean of the two directions."""
    return 1.0 / float(math.hypot(1.0, *point) ** 1.5)


def _tips(left: ImagePoint, right: ImagePoint, sigmas: tuple[float, ...]) -> tuple[ImageFeature, ImageFeature]:
    """Both wingtips as points that say no more than which one is which: the wing itself is measured apart."""
    at_least = TIPS * math.dist(left, right)
    a, b = (max(SIDES * sigma, at_least) for sigma in sigmas)
    return ImageFeature(name="left", point=left, sigma=a), ImageFeature(name="right", point=right, sigma=b)


def measure(filter_: BeliefFilter, saw: Features) -> Measurement:
    """The filter's measurement of it: what was not seen has noise without bound."""
    measured = filter_.measure(np.array(saw.points), np.array(saw.sigmas))
    if saw.named:
        shows = of_points(filter_.shape, saw.named, measured.axes, has_center=saw.has_center)
        measured = measured._replace(shows=shows)
    if saw.pose is not None:
        measured = measured._replace(pose=measured_pose(saw.pose, filter_.shape.pose_bias, measured.axes[0]))
    if saw.has_center and saw.has_wing:
        return measured
    y, R = measured.y.copy(), measured.R.copy()
    R[[0, 1], [0, 1]] += (BIAS_COUNTS * saw.offset) ** 2
    first = 4 if saw.has_wing else 2  # the wing's middle was taken for the center: it is not measured twice
    for i in range(first, len(y)):
        y[i], R[i, :], R[:, i] = 0.0, 0.0, 0.0
        R[i, i] = UNKNOWN**2
    measured = measured._replace(y=y, R=R)
    if saw.has_wing:
        return measured
    shows = measured.shows
    shape, box = filter_.shape, saw.box
    if shows and shows.has_extent:
        box = None
    elif measured.pose is not None and measured.pose.range_ is not None:
        return _metric(measured, measured.pose.range_, shape.size)
    if box is not None:
        shows = of_box(shape, *box, measured.axes)
        y[:4] = MIDDLE_AND_SIZE @ shows.rows.y
    extent = (shows.spread, shows.spread_sigma) if shows and shows.has_extent else (measured.span, math.inf)
    return measured._replace(span=extent[0], span_sigma=extent[1], shows=shows, has_wing=False)


def _metric(measured: Measurement, range_: float, size: float) -> Measurement:
    """The measurement where a pose alone shows the range."""
    span, sigma = size / range_, measured.pose.range_sigma if measured.pose is not None else math.inf
    return measured._replace(span=span, span_sigma=span * sigma / range_, has_wing=False, is_metric=True)


def refused(measurement: Measurement, state: Any) -> Update:
    """The update by a direction that the filter could not use, because it would have had to start again with
    it."""
    m = len(measurement.y)
    return Update(state, np.zeros(m), np.eye(m), measurement.y, math.inf)
