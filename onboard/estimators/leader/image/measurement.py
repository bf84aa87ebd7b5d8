"""What one image measures of a leader, as rows: a wing, a direction, named points, a box.

Image points become coordinates (right, down), rad, on the plane tangent to the sphere of directions at the
measured center. The projection is stereographic: smooth everywhere but exactly opposite the center, so a leader
predicted behind the camera is not folded to the front, and for a small wing the coordinates are the angles.

A wing is the center's direction and the line from the left wingtip to the right one: four rows. Compared with Oh &
Johnson's subtended angle (eq 17) this adds the wing's slope, which shows the bank; the wing's length depends on
the leader's heading. If the center is the middle between the wingtips, as in their paper, the middle of the wing's
image is measured too: six rows. It measures the direction a second time. And since the nearer half of a wing looks
longer, it shows to which side and how far the wing is turned out of the image plane: the middle moves by a
fraction of half the wing, half the wing over the distance. That is a few percent: a swept wing moves its middle by
more.

A box is its middle, its width and its height. A direction is two rows, and a named point, too.
"""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.image.pose import PoseFeatures
from onboard.estimators.leader.image.shape import RIGID, WINGTIPS, Posture, Shape
from onboard.messages import ImagePoint

COMPONENTS: Final = ("right", "down", "wing_right", "wing_down", "middle_right", "middle_down")
WING: Final = slice(2, 4)  # of the rows of a wing: from wingtip to wingtip; of a box: its width and height
LOWEST: Final = -1  # in place of a point's number: the point with the least coordinate ...
HIGHEST: Final = -2  # ... and the one with the largest
BOTH_AXES: Final = np.array([0, 1])


class Rows(NamedTuple):
    """What is measured, y (m,) rad with noise R (m, m), and of what: points (k, 3) of the body in b, for a
    wingspan of 1; for each row the numbers of two points, or LOWEST or HIGHEST, their shares (m, 2), and the axis
    (m,), 0 right or 1 down."""

    y: Array
    R: Array
    points: Array
    of: Array
    shares: Array
    axis: Array
    is_wing: bool = False
    names: tuple[str, ...] = ()  # of points, two rows each, that tell the nose from the tail
    posture: Posture = RIGID
    bias: float | None = None  # of the size, one standard deviation: of a box

    @property
    def named(self) -> bool:
        """Whether the points tell the nose from the tail."""
        return bool(self.names)

    @property
    def is_box(self) -> bool:
        """Whether these are a box's middle and size."""
        return self.bias is not None


class Extent(NamedTuple):
    """The rows whose spread shows the range of a first image, the spread, rad, and the standard deviation of each
    of their coordinates."""

    rows: Rows
    spread: float
    sigma: float


class Measurement(NamedTuple):
    """Of one image."""

    rows: Rows  # by which it is judged
    span: float  # rad, of the wing; where it was not seen, of what was, or by a pose that of the wing broadside
    span_sigma: float  # rad; infinite if nothing shows the range
    axes: Array  # (3, 3) unit vectors in c: to the center, and the two along which the wing is measured
    further: Rows | None = None  # named points, beyond these
    extent: Extent | None = None  # of points or a box, where no wing was seen
    edge_on_visibility: float | None = (
        None  # of the wing's length, what the edge-on aircraft shows of these; None: nothing new
    )
    off: float = 0.0  # rad, by which the center may be off a box's middle
    keypoint_bias: float = 0.0  # of the length between nose and tail: the bias of named points
    pose: PoseFeatures | None = None
    is_metric: bool = False  # a pose alone shows the range, which does not depend on the size

    @property
    def y(self) -> Array:
        """What is measured (m,)."""
        return self.rows.y

    @property
    def has_wing(self) -> bool:
        """Whether it was seen."""
        return self.rows.is_wing

    @property
    def has_extent(self) -> bool:
        """Whether it says something of the range."""
        return math.isfinite(self.span_sigma)

    def with_attitude_noise(self, noise_c: Array) -> "Measurement":
        """The measurement by a camera whose attitude has white noise, a small rotation in c of covariance noise_c
        (3, 3): all directions move together, and a wing turns about them."""
        if not np.logical_or.reduce(noise_c, axis=None):
            return self
        rows, (line, right, down) = self.rows, self.axes
        by = np.where(rows.axis[:, None] == 0, down, -right) * rows.shares.sum(axis=1)[:, None]
        if rows.is_wing:
            by[2], by[3] = -rows.y[3] * line, rows.y[2] * line
        return self._replace(rows=rows._replace(R=rows.R + by @ noise_c @ by.T))


class Layout(NamedTuple):
    """Of which points rows are, with which shares, and along which axis (`Rows`)."""

    of: Array
    shares: Array
    axis: Array

    def first(self, m: int) -> "Layout":
        """The first m rows."""
        return Layout(self.of[:m], self.shares[:m], self.axis[:m])


CENTER: Final = np.zeros((1, 3))
WING_POINTS: Final = np.vstack([CENTER, WINGTIPS])
WING_AND_MIDDLE: Final = Layout(
    np.array([[0, 0], [0, 0], [2, 1], [2, 1], [1, 2], [1, 2]]),
    np.array([[1.0, 0.0], [1.0, 0.0], [1.0, -1.0], [1.0, -1.0], [0.5, 0.5], [0.5, 0.5]]),
    np.tile(BOTH_AXES, 3),
)
OF_WING: Final = WING_AND_MIDDLE.first(4)
OF_DIRECTION: Final = WING_AND_MIDDLE.first(2)
OF_BOX: Final = Layout(
    np.array([[LOWEST, HIGHEST], [LOWEST, HIGHEST], [HIGHEST, LOWEST], [HIGHEST, LOWEST]]),
    np.array([[0.5, 0.5], [0.5, 0.5], [1.0, -1.0], [1.0, -1.0]]),
    np.tile(BOTH_AXES, 2),
)


def measure_wing(points: Sequence[ImagePoint], sigmas: Sequence[float], *, middle: bool = False) -> Measurement:
    """What image points measure of a wing, center, left and right with standard deviations, all in focal lengths;
    with its `middle` if that is to be measured."""
    axes, layout = axes_about(points[0]), WING_AND_MIDDLE if middle else OF_WING
    y, R = _measured(axes, points, sigmas, layout)
    (a, b), ((aa, ab), (_, bb)) = y[WING].tolist(), R[WING, WING].tolist()
    span, along = math.hypot(a, b), max(a * a * aa + 2 * a * b * ab + b * b * bb, 0.0)
    sigma = math.sqrt(along) / span if span > 0 else math.sqrt(aa)
    return Measurement(Rows(y, R, WING_POINTS, *layout, is_wing=True), span, sigma, axes)


def measure_direction(point: ImagePoint, sigma: float) -> Measurement:
    """What one image point measures."""
    axes = axes_about(point)
    y, R = _measured(axes, [point], [sigma], OF_DIRECTION)
    return Measurement(Rows(y, R, CENTER, *OF_DIRECTION), 1.0, math.inf, axes)


def rows_of_points(axes: Array, known: Sequence[tuple[str, Array, ImagePoint, float]], posture: Posture) -> Rows:
    """The rows of points of a body, each with its name, its place (3,) in b, and where and how exactly it was
    seen."""
    names, places, seen, sigmas = zip(*known, strict=True)
    y, _ = coordinates(axes, seen)
    k = len(known)
    of: Any = np.repeat(np.arange(k), 4).reshape(-1, 2)
    layout = Layout(of, np.tile([1.0, 0.0], (2 * k, 1)), np.tile(BOTH_AXES, k))
    R = np.diag(np.repeat(np.square(sigmas), 2))
    return Rows(y.ravel(), R, np.array(places), *layout, names=tuple(names), posture=posture)


def rows_of_box(axes: Array, sides: Sequence[ImagePoint], share: float, shape: Shape) -> Rows:
    """The rows of a box, by the middles of its left, upper, right and lower side, each with noise of this `share`
    of the larger one."""
    at, _ = coordinates(axes, sides)
    left, upper, right, lower = at[0, 0], at[1, 1], at[2, 0], at[3, 1]
    larger = max(right - left, lower - upper)
    across, tall = (share * larger) ** 2, (share**2 + shape.height**2) * larger**2
    y = np.array([0.5 * (left + right), 0.5 * (upper + lower), right - left, lower - upper])
    R = np.diag([0.5 * across, 0.5 * tall, 2.0 * across, 2.0 * tall])
    return Rows(y, R, shape.bounds, *OF_BOX, posture=shape.posture, bias=shape.box_bias)


def axes_about(point: ImagePoint) -> Array:
    """Unit vectors (3, 3) in c about an image point: towards it, to the right, and down."""
    u, v = point
    length, level = math.sqrt(1.0 + u * u + v * v), math.sqrt(1.0 + u * u)
    both = length * level
    return np.array(
        [
            (1.0 / length, u / length, v / length),
            (-u / level, 1.0 / level, 0.0),
            (-v / both, -u * v / both, level / length),
        ]
    )


def coordinates(axes: Array, points: Sequence[ImagePoint]) -> tuple[Array, Array]:
    """Stereographic coordinates (k, 2) of image points about the first of `axes`, and their derivatives (k, 2, 2)
    by those of the points."""
    directions = np.array([(1.0, u, v) for u, v in points])
    length = np.sqrt(np.add.reduce(directions * directions, axis=1, keepdims=True))
    below = length + directions @ axes[0][:, None]
    at = 2.0 * (directions @ axes[1:].T) / below
    turns = directions[:, 1:] / length + axes[0, 1:]
    return at, (2.0 * axes[1:, 1:] - at[:, :, None] * turns[:, None, :]) / below[:, :, None]


def _measured(
    axes: Array, points: Sequence[ImagePoint], sigmas: Sequence[float], layout: Layout
) -> tuple[Array, Array]:
    """What rows (m,) of image points with these standard deviations measure, and its noise (m, m)."""
    of, shares, axis = layout
    at, by_points = coordinates(axes, points)
    m = len(axis)
    by = np.zeros((m, len(points), 2))  # of the rows, by the coordinates of each point on the image
    for side in (0, 1):
        by[np.arange(m), of[:, side]] += shares[:, side, None] * by_points[of[:, side], axis]
    by *= np.array(sigmas)[:, None]
    flat = by.reshape(m, -1)
    return np.add.reduce(shares * at[of, axis[:, None]], axis=1), flat @ flat.T


def points_of(axes: Array, y: Array) -> Array:
    """Image points, (3, 2) of a measurement y (m,) with a wing about `axes` (3, 3), in focal lengths: center, left
    and right wingtip, as if the center were the wing's middle; of a direction the center (1, 2). NaN for a point
    behind the camera."""
    places = y[:2][None]
    if len(y) > 2:
        places = places + 0.5 * np.array([[0.0], [-1.0], [1.0]]) * y[WING]
    quarter = 0.25 * np.add.reduce(places**2, axis=1, keepdims=True)
    directions = (1.0 - quarter) * axes[0] + places @ axes[1:]
    ahead = np.where(directions[:, :1] > 0.0, directions[:, :1], np.nan)
    return np.asarray(directions[:, 1:] / ahead)


def measured_spread(rows: Rows, y: Array) -> Array:
    """How far the coordinates (..., m) of points are apart, or those of a box's sides, root of the sum of
    squares."""
    if rows.is_box:
        return np.asarray(np.sqrt(0.5 * np.add.reduce(y[..., WING] ** 2, axis=-1)))
    total = np.zeros(y.shape[:-1])
    for axis in BOTH_AXES:
        of_axis = y[..., rows.axis == axis]
        total += np.sum((of_axis - of_axis.mean(axis=-1, keepdims=True)) ** 2, axis=-1)
    return np.sqrt(total)
