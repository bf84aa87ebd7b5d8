"""One image prepared for a track.

What it shows of an aircraft, whether it can be used, what it measures, and from which pose it was taken.

A detection may have not all three points of the wing, or more:
- Both wingtips without the center: the wing as ever. The center is near the wing's middle, but not on it, unless
  `center_on_wing` says so: its direction is that of the middle, with noise in proportion to the wing.
- The center, one wingtip, another point, or a box: a direction. A wingtip is half a wing off the center, the
  middle of a box may be a tenth of the box off, and that of a box which the image's edge may cut off half a wing.
  Such an offset is a bias, which images do not average out: it counts `OFFSET_BIAS_FACTOR` times.
- Further points of the class, and, where the wing was not seen, a box: see `measurement`.
- A pose: see `pose`. Where nothing else shows the size, its range is the range.

A direction alone starts no track: it says nothing of the range."""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.image.camera_pose import CameraPose, CameraPoses, PosedExposure
from onboard.estimators.leader.image.measurement import (
    Extent,
    Measurement,
    measure_direction,
    measure_wing,
    measured_spread,
    rows_of_box,
    rows_of_points,
)
from onboard.estimators.leader.image.pose import measured_pose
from onboard.estimators.leader.image.shape import Shape
from onboard.geometry.camera import Camera
from onboard.geometry.lens import MAX_IMAGE_RADIUS, Edges
from onboard.messages import (
    ImageFeature,
    ImagePoint,
    RelativePose,
    Sides,
    TargetDetection,
    TargetImage,
    TargetPoints,
    Verdict,
)
from onboard.ownship import Ownship
from onboard.units import NS_PER_S


class Features(NamedTuple):
    """Features of an aircraft in an image, in focal lengths."""

    points: tuple[ImagePoint, ...]  # center, left and right; or a direction alone
    sigmas: tuple[float, ...]  # theirs
    offset: float = 0.0  # how far off the center may be by a bias
    has_center: bool = True  # it was seen, and nothing stands for it
    named: tuple[ImageFeature, ...] = ()  # all points that have names
    box: tuple[Sides, float] | None = None  # and the noise of each side, in shares of the larger one
    pose: RelativePose | None = None  # the detector's own

    def noisier(self, scale: float) -> "Features":
        """The same by a detector whose points are this many times as noisy."""
        if scale == 1.0:
            return self

        def noisy(feature: ImageFeature) -> ImageFeature:
            return replace(feature, sigma=scale * feature.sigma)

        box = None if self.box is None else (self.box[0], scale * self.box[1])
        named = tuple(map(noisy, self.named))
        return self._replace(sigmas=tuple(scale * sigma for sigma in self.sigmas), named=named, box=box)


def features_of(message: TargetImage, camera_sigma: float, *, center_on_wing: bool, half_wing: float) -> Features:
    """Return the features of a message.

    `camera_sigma`: of a point without its own; `half_wing`: half the wing as it appears at most, where one wingtip
    is all that is seen. All in focal lengths."""
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
        off = given.CENTER_ON_WING_OFFSET_RATIO if center_on_wing else given.CENTER_OFFSET_RATIO
        points = ((a + c) / 2, (b + d) / 2), left.point, right.point
        offset = off * math.dist(*points[1:]) * _angle(points[0])
        sigmas = sigma, left.sigma, right.sigma
        others = tuple(f for name, f in features.items() if name not in ("left", "right"))
        tips = _tips(left.point, right.point, (left.sigma, right.sigma))
        return Features(points, sigmas, offset, has_center=False, named=(*others, *tips), pose=message.pose)
    one, half_width = features.get("center", message.features[0]), message.half_width or 0.0
    of_whole_box = 2.0 * given.BOX_CENTER_OFFSET_RATIO * half_width * _angle(one.point)
    of_box = of_whole_box if message.sides else max(of_whole_box, half_wing)
    offset = {"center": 0.0, "box": of_box}.get(one.name, half_wing)
    has_center = one.name == "center"
    box = None
    if message.sides and half_width:
        box = message.sides, max(features["box"].sigma / (2.0 * half_width), given.MIN_BOX_SIGMA_RATIO)
    return Features((one.point,), (one.sigma,), offset, has_center, message.features, box, message.pose)


def _angle(point: ImagePoint) -> float:
    """Radians per focal length about a point, the geometric mean of the two directions."""
    return 1.0 / float(math.hypot(1.0, *point) ** 1.5)


def _tips(left: ImagePoint, right: ImagePoint, sigmas: tuple[float, ...]) -> tuple[ImageFeature, ImageFeature]:
    """Both wingtips as points that say no more than which one is which.

    The wing itself is measured apart."""
    at_least = given.WINGTIP_NAME_NOISE * math.dist(left, right)
    a, b = (max(given.WINGTIP_NAME_SIGMAS * sigma, at_least) for sigma in sigmas)
    return ImageFeature(name="left", point=left, sigma=a), ImageFeature(name="right", point=right, sigma=b)


def measure(shape: Shape, saw: Features) -> Measurement:
    """Measure a target of this shape."""
    if len(saw.points) > 1:
        middle = shape.center_on_wing and saw.has_center  # which was not taken for the center
        measured = measure_wing(saw.points, saw.sigmas, middle=middle)
    else:
        measured = measure_direction(saw.points[0], saw.sigmas[0])
    axes = measured.axes
    if saw.offset:
        measured.rows.R[[0, 1], [0, 1]] += (given.OFFSET_BIAS_FACTOR * saw.offset) ** 2
    if saw.pose is not None:
        measured = measured._replace(pose=measured_pose(saw.pose, shape.pose_bias, axes[0]))
    if known := [
        (f.name, shape.points[shape.names.index(f.name)], f.point, f.sigma)
        for f in saw.named
        if f.name in shape.names
    ]:
        measured = _with_points(measured, shape, known, saw.points[0] if saw.has_center else None)
    if measured.span_sigma < math.inf:  # a wing's, or that of points
        return measured
    if measured.pose is not None and measured.pose.range_ is not None:
        range_, sigma = measured.pose.range_, measured.pose.range_sigma
        return measured._replace(
            span=shape.size / range_, span_sigma=shape.size * sigma / range_**2, is_metric=True
        )
    if saw.box is None:
        return measured
    sides, share = saw.box
    rows = rows_of_box(axes, sides, share, shape)
    sigma = math.sqrt(0.5 * rows.R[2, 2])
    measured = measured._replace(
        rows=rows, further=None, keypoint_bias=0.0, off=given.OFFSET_BIAS_FACTOR * saw.offset
    )
    return _with_extent(measured, Extent(rows, 0.0, sigma), shape.edge_on_visibility)


def _with_points(
    measured: Measurement,
    shape: Shape,
    known: list[tuple[str, Array, ImagePoint, float]],
    center: ImagePoint | None,
) -> Measurement:
    """The measurement with named points of the class, each with its place (3,) and where and how exactly it was
    seen. Without a wing, how far they and the center are apart may show the range."""
    further = rows_of_points(measured.axes, known, shape.posture)
    length = float(np.ptp(np.append(further.points[:, 0], 0.0)))
    keypoint_bias = math.sqrt(2.0) * given.KEYPOINT_SIGMA_RATIO / length if length > given.MIN_NOSE_LENGTH else 0.0
    measured = measured._replace(further=further, keypoint_bias=keypoint_bias)
    if measured.rows.is_wing:
        return measured
    seen = known if center is None else [*known, ("center", np.zeros(3), center, 0.0)]
    sigma = math.sqrt(2.0) * max(sigma for *_, sigma in known)
    return _with_extent(
        measured, Extent(rows_of_points(measured.axes, seen, shape.posture), 0.0, sigma), shape.edge_on_visibility
    )


def _with_extent(measured: Measurement, extent: Extent, edge_on_visibility: float) -> Measurement:
    """The measurement with an extent, whose spread says something of the range if it is more than noise."""
    extent = extent._replace(spread=float(measured_spread(extent.rows, extent.rows.y)))
    measured = measured._replace(extent=extent, edge_on_visibility=edge_on_visibility)
    if extent.spread <= given.MIN_SPAN_SIGMAS * extent.sigma:
        return measured
    return measured._replace(span=extent.spread, span_sigma=extent.sigma)


class Image(NamedTuple):
    """A usable image, with the camera's pose when it was taken, as in its `view`.

    An extrapolated pose is computed again when the image is fused. Without an extent (`has_extent`) it shows a
    direction alone. The measurement supposes a detector that is `noise_scale` times as noisy as `points` states,
    and a `half_wing` where that matters, else 0."""

    message: TargetImage
    has_extent: bool
    measurement: Measurement
    pose: CameraPose
    view: PosedExposure
    points: Features
    noise_scale: float
    half_wing: float = 0.0

    def supposes(self, half_wing: float, noise_scale: float) -> bool:
        """Whether it would be the same by these."""
        return self.noise_scale == noise_scale and self.half_wing in (0.0, half_wing)

    @property
    def direction_n(self) -> Array:
        """Direction (3,) of the center, a unit vector in n."""
        direction: Array = self.measurement.axes[0] @ self.pose.R_cn
        return direction


def prepare(
    message: TargetImage,
    view: PosedExposure,
    ownship: Ownship,
    shape: Shape,
    config: Config,
    half_wing: float,
    noise_scale: float = 1.0,
) -> Image | Verdict:
    """A detection of an exposure, of a target of this `shape`, or why it cannot be used.

    The detector is `noise_scale` times as noisy as configured; `half_wing`: see `features_of`. Points within
    `edge_px` of the image's edge count as outside: the edge may cut an aircraft off, and then they are not its
    wingtips."""
    saw = features_of(message, view.sigma, center_on_wing=config.center_on_wing, half_wing=half_wing)
    stated, saw = saw, saw if noise_scale == 1.0 else saw.noisier(noise_scale)
    # a few: Python's arithmetic is fast
    sigmas = *saw.sigmas, *(feature.sigma for feature in saw.named)
    numbers = [x for point in (*saw.points, *(feature.point for feature in saw.named)) for x in point]
    if not (all(map(math.isfinite, numbers)) and all(map(math.isfinite, sigmas))):
        return Verdict.NOT_FINITE
    pose = view.pose
    if pose is None:
        return _why_no_pose(message.t_ns, ownship, config)
    least, most = given.POINT_SIGMA_LIMITS
    if max(map(abs, numbers)) > MAX_IMAGE_RADIUS or min(sigmas) < least or max(sigmas) > most:
        return Verdict.DEGENERATE
    if not in_view(saw.points, view.camera, message.view, config.edge_px):
        return Verdict.OUT_OF_VIEW
    measurement = measure(shape, saw)
    has_wing = measurement.rows.is_wing
    if has_wing and not measurement.span > 0.0:
        return Verdict.DEGENERATE
    # A track takes small spans, too: without them those would be left that noise has made larger.
    is_small = has_wing and measurement.span < given.MIN_SPAN_SIGMAS * measurement.span_sigma
    has_extent = measurement.span_sigma < math.inf and not is_small
    supposed = half_wing if saw.offset == half_wing else 0.0
    return Image(message, has_extent, measurement, pose, view, stated, noise_scale, supposed)


def _why_no_pose(t_ns: int, ownship: Ownship, config: Config) -> Verdict:
    """Why there is no pose at a time.

    It may be that of another clock, or attitude or position has stopped."""
    if ownship.now_ns <= 0:
        return Verdict.NO_POSE
    if t_ns > ownship.now_ns:
        return Verdict.TOO_NEW
    is_old = ownship.now_ns - t_ns > config.rewind_horizon_s * NS_PER_S
    return Verdict.TOO_OLD if is_old and ownship.lead_ns(t_ns) <= 0 else Verdict.NO_POSE


def newest_pose(image: Image, poses: CameraPoses, ownship: Ownship) -> CameraPose:
    """The pose from which an image was taken, as it is known now."""
    message, camera = image.message, image.view.camera
    return poses.at(message.t_ns, ownship, camera, message.mount) or image.pose


def in_view(points: Iterable[ImagePoint], camera: Camera, view: Edges | None, edge_px: float) -> bool:
    """Whether all points are inside the image, of the given edges or the configured camera's, by `edge_px`."""
    left, upper, right, lower = view or camera.edges
    edge = edge_px / camera.f_px
    return all(left + edge <= u <= right - edge and upper + edge <= v <= lower - edge for u, v in points)


def agree(a: Image, b: Image) -> bool:
    """Whether two images could be of one aircraft a moment apart.

    Same direction in n, and same span, where both show the wing or neither does."""
    a_, b_ = a.measurement, b.measurement
    ratio = a_.span / b_.span if a_.has_wing == b_.has_wing else 1.0
    near = float(a.direction_n @ b.direction_n) > np.cos(given.MAX_AGREEING_ANGLE)
    return bool(near and 1 / given.MAX_SPAN_RATIO < ratio < given.MAX_SPAN_RATIO)


def hold(held: deque[Image], image: Image) -> None:
    """Add an image to those of the last second, in place.

    One that does not agree with them replaces them."""
    while held and image.message.t_ns - held[0].message.t_ns > NS_PER_S:
        held.popleft()
    if held and not agree(held[-1], image):
        held.clear()
    held.append(image)
