"""One image made ready for a track: whether it can be used, what it measures, and from where it was taken."""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from onboard.estimators.leader.filter import LeaderFilter, Seen, View
from onboard.geometry.camera import Camera
from onboard.messages import ImagePoint, TargetPoints, Verdict
from onboard.ownship import Ownship

AGREE_RAD: Final = np.radians(5.0)  # images of one aircraft point the same way this nearly ...
AGREE_RATIO: Final = 1.3  # ... and show the same span within this factor
SMALLEST_SPAN_SIGMA: Final = 2.0  # a span below this many of its sigmas says nothing of the range
WIDEST: Final = 100.0  # focal lengths from the axis (89.4 degrees): no lens shows a point beyond
SIGMAS: Final = (1e-7, 10.0)  # focal lengths: finer or coarser than this no point is found
TURN_NS: Final = 40_000_000  # over which the camera's rates are taken
MOST_VIEWS: Final = 64  # kept, where own motion stands still and images do not


class Image(NamedTuple):
    """An image made ready, and the camera's view then; `final` once that is interpolated: an extrapolated one is
    asked for again."""

    message: TargetPoints
    seen: Seen
    view: View
    final: bool


class Eye:
    """The camera as it flies: its own pose and rates, from ours. What is the same for all targets in an image is
    found once."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._views: dict[int, View | None] = {}
        self._as_of: tuple[Ownship, int] | None = None

    def at(self, t_ns: int, ownship: Ownship) -> View | None:
        """The view at a time, None where our pose is not known."""
        as_of = ownship, ownship.samples
        if self._as_of != as_of or len(self._views) >= MOST_VIEWS:
            self._views.clear()
            self._as_of = as_of
        if t_ns not in self._views:
            self._views[t_ns] = self._view(t_ns, ownship)
        return self._views[t_ns]

    def _view(self, t_ns: int, ownship: Ownship) -> View | None:
        pose, before = ownship.pose_at(t_ns), ownship.pose_at(t_ns - TURN_NS)
        if pose is None:
            return None
        camera = self.camera
        R_cn = camera.R_bc.T @ pose.R_nb.T
        # R_c(now) c(before) = exp(-[turn])
        turned = np.eye(3) if before is None else R_cn @ (before.R_nb @ camera.R_bc)
        turn = np.array([turned[1, 2] - turned[2, 1], turned[2, 0] - turned[0, 2], turned[0, 1] - turned[1, 0]])
        return View(R_cn, pose.R_nb @ camera.r_FC_b, pose.v_F_n, 0.5 * turn / (TURN_NS * 1e-9))


def ready(
    message: TargetPoints, ownship: Ownship, eye: Eye, filter_: LeaderFilter, edge_px: float
) -> Image | Verdict:
    """The image, or why it cannot be used. Points within `edge_px` of the image's edge are outside it: an aircraft
    cut by the edge is not seen where it is."""
    camera = eye.camera
    points = message.center, message.left, message.right
    sigmas = message.sigma or (camera.sigma,) * 3
    numbers = [*message.center, *message.left, *message.right]  # a few: Python's own arithmetic is the fastest
    if not (all(map(math.isfinite, numbers)) and all(map(math.isfinite, sigmas))):
        return Verdict.NOT_FINITE
    view = eye.at(message.t_ns, ownship)
    if view is None:
        newer = message.t_ns > ownship.now_ns and ownship.now_ns > 0
        return Verdict.TOO_NEW if newer else Verdict.NO_POSE
    if max(map(abs, numbers)) > WIDEST or min(sigmas) < SIGMAS[0] or max(sigmas) > SIGMAS[1]:
        return Verdict.DEGENERATE
    if not in_view(points, camera, message.half_view, edge_px):
        return Verdict.OUT_OF_VIEW
    seen = filter_.see(np.array(points), np.array(sigmas))
    if seen.span < SMALLEST_SPAN_SIGMA * seen.span_sigma:
        return Verdict.DEGENERATE
    return Image(message, seen, view, ownship.knows(message.t_ns))


def in_view(points: Iterable[ImagePoint], camera: Camera, half_view: ImagePoint | None, edge_px: float) -> bool:
    """Whether all points are inside the image, of the given half extent or the configured camera's."""
    half = half_view or (0.5 * camera.width_px / camera.f_px, 0.5 * camera.height_px / camera.f_px)
    edge = edge_px / camera.f_px
    return all(abs(u) <= half[0] - edge and abs(v) <= half[1] - edge for u, v in points)


def agree(a: Image, b: Image) -> bool:
    """Whether two images could be of one aircraft a moment apart: same direction in n, same span."""
    ratio = a.seen.span / b.seen.span
    near = float((a.seen.look_c @ a.view.R_cn) @ (b.seen.look_c @ b.view.R_cn)) > np.cos(AGREE_RAD)
    return bool(near and 1 / AGREE_RATIO < ratio < AGREE_RATIO)
