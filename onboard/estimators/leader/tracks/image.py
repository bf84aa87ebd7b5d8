"""One image prepared for a track: whether it can be used, what it measures, and from which pose it was taken."""

import math
from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose, CameraPoses
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.filters import features
from onboard.estimators.leader.filters.belief import BeliefFilter
from onboard.estimators.leader.filters.features import Features
from onboard.estimators.leader.filters.measurement import Measurement
from onboard.geometry.camera import Camera
from onboard.geometry.lens import WIDEST, Edges
from onboard.geometry.units import NS_PER_S
from onboard.messages import ImagePoint, TargetImage, Verdict
from onboard.ownship import Ownship

AGREE_RAD: Final = np.radians(5.0)  # images of one aircraft point the same way this nearly ...
AGREE_RATIO: Final = 1.3  # ... and show the same span within this factor
SMALLEST_SPAN_SIGMA: Final = 2.0  # a span below this many of its sigmas says nothing of the range by itself
SIGMAS: Final = (1e-7, 10.0)  # focal lengths: no detector is more exact or less


class Image(NamedTuple):
    """A usable image, with the camera's pose when it was taken. The pose is `final` if it was interpolated; an
    extrapolated one is computed again when the image is fused. Without an extent (`has_extent`) it shows a
    direction alone (see `features`). The measurement supposes a detector that is `noise_scale` times as noisy as
    `points` states, and a `half_wing` where that matters, else 0."""

    message: TargetImage
    has_extent: bool
    measurement: Measurement
    pose: CameraPose
    final: bool
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
    ownship: Ownship,
    poses: CameraPoses,
    filter_: BeliefFilter,
    config: Config,
    half_wing: float,
    noise_scale: float = 1.0,
) -> Image | Verdict:
    """The image, or why it cannot be used (`half_wing`: see `features_of`), by a detector that is `noise_scale`
    times as noisy as configured. Points within `edge_px` of the image's edge count as outside: the edge may cut an
    aircraft off, and then they are not its wingtips."""
    camera = poses.camera.named(message.camera)
    saw = features.features_of(message, camera.sigma, center_on_wing=config.center_on_wing, half_wing=half_wing)
    stated, saw = saw, saw.noisier(noise_scale)
    # a few: Python's arithmetic is fast
    sigmas = *saw.sigmas, *(feature.sigma for feature in saw.named)
    numbers = [x for points in (saw.points, saw.named_points) for point in points for x in point]
    if not (all(map(math.isfinite, numbers)) and all(map(math.isfinite, sigmas))):
        return Verdict.NOT_FINITE
    pose = poses.at(message.t_ns, ownship, camera, message.mount)
    if pose is None:
        return _why_no_pose(message.t_ns, ownship, config)
    if max(map(abs, numbers)) > WIDEST or min(sigmas) < SIGMAS[0] or max(sigmas) > SIGMAS[1]:
        return Verdict.DEGENERATE
    points = saw.points if saw.has_wing else saw.points[:1]
    if not in_view(points, camera, message.view, config.edge_px):
        return Verdict.OUT_OF_VIEW
    measurement = features.measure(filter_, saw)
    if saw.has_wing and not measurement.span > 0.0:
        return Verdict.DEGENERATE
    # A track takes small spans, too: without them those would be left that noise has made larger.
    is_small = saw.has_wing and measurement.span < SMALLEST_SPAN_SIGMA * measurement.span_sigma
    has_extent = measurement.has_extent and not is_small
    is_final = poses.is_final(message.t_ns, ownship, camera, message.mount)
    supposed = half_wing if saw.offset == half_wing else 0.0
    return Image(message, has_extent, measurement, pose, is_final, stated, noise_scale, supposed)


def _why_no_pose(t_ns: int, ownship: Ownship, config: Config) -> Verdict:
    """Why there is no pose at a time: it may be that of another clock, or attitude or position has stopped."""
    if ownship.now_ns <= 0:
        return Verdict.NO_POSE
    if t_ns > ownship.now_ns:
        return Verdict.TOO_NEW
    is_old = ownship.now_ns - t_ns > config.rewind_horizon_s * NS_PER_S
    return Verdict.TOO_OLD if is_old and ownship.lead_ns(t_ns) <= 0 else Verdict.NO_POSE


def measured(image: Image, filter_: BeliefFilter, noise_scale: float) -> Measurement:
    """What an image measures by a detector that is so many times as noisy as configured."""
    if noise_scale == image.noise_scale:
        return image.measurement
    return features.measure(filter_, image.points.noisier(noise_scale))


def newest_pose(image: Image, poses: CameraPoses, ownship: Ownship) -> CameraPose:
    """The pose from which an image was taken, as it is known now."""
    if image.final:
        return image.pose
    message = image.message
    return poses.at(message.t_ns, ownship, poses.camera.named(message.camera), message.mount) or image.pose


def in_view(points: Iterable[ImagePoint], camera: Camera, view: Edges | None, edge_px: float) -> bool:
    """Whether all points are inside the image, of the given edges or the configured camera's, by `edge_px`."""
    left, upper, right, lower = view or camera.edges
    edge = edge_px / camera.f_px
    return all(left + edge <= u <= right - edge and upper + edge <= v <= lower - edge for u, v in points)


def agree(a: Image, b: Image) -> bool:
    """Whether two images could be of one aircraft a moment apart: same direction in n, and same span, where both
    show the wing or neither does."""
    a_, b_ = a.measurement, b.measurement
    ratio = a_.span / b_.span if a_.has_wing == b_.has_wing else 1.0
    near = float(a.direction_n @ b.direction_n) > np.cos(AGREE_RAD)
    return bool(near and 1 / AGREE_RATIO < ratio < AGREE_RATIO)


def hold(held: deque[Image], image: Image) -> None:
    """Add an image to those of the last second, in place; one that does not agree with them replaces them."""
    while held and image.message.t_ns - held[0].message.t_ns > NS_PER_S:
        held.popleft()
    if held and not agree(held[-1], image):
        held.clear()
    held.append(image)
