"""Measurements of one image as rows: a wing, a direction, named points, a box.

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
from onboard.compiled import BOOL, INDICES, INT, MAKING, OUT, ROWS, VECTOR, array, kernel
from onboard.estimators.leader.image.pose import PoseFeatures
from onboard.estimators.leader.image.shape import RIGID, WINGTIPS, Posture, Shape
from onboard.messages import ImagePoint

COMPONENTS: Final = ("right", "down", "wing_right", "wing_down", "middle_right", "middle_down")
WING: Final = slice(2, 4)  # of the rows of a wing: from wingtip to wingtip; of a box: its width and height
LOWEST: Final = -1  # in place of a point's number: the point with the least coordinate ...
HIGHEST: Final = -2  # ... and the one with the largest
BOTH_AXES: Final = np.array([0, 1])


class Rows(NamedTuple):
    """Measured rows: y (m,) rad with noise R (m, m), and of what.

    Points (k, 3) of the body in b, for a wingspan of 1; for each row the numbers of two points, or LOWEST or
    HIGHEST, their shares (m, 2), and the axis (m,), 0 right or 1 down."""

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
    """The measurement of one image."""

    rows: Rows  # by which it is judged
    span: float  # rad, of the wing; where it was not seen, of what was, or by a pose that of the wing broadside
    span_sigma: float  # rad; infinite if nothing shows the range
    axes: Array  # (3, 3) unit vectors in c: to the center, and the two along which the wing is measured
    further: Rows | None = None  # named points, beyond these
    extent: Extent | None = None  # of points or a box, where no wing was seen
    # Of the wing's length, what the edge-on aircraft shows of these; None: nothing new
    edge_on_visibility: float | None = None
    off: float = 0.0  # rad, by which the center may be off a box's middle
    keypoint_bias: float = 0.0  # of the length between nose and tail: the bias of named points
    pose: PoseFeatures | None = None
    is_metric: bool = False  # a pose alone shows the range, which does not depend on the size

    @property
    def y(self) -> Array:
        """Return the measured rows (m,)."""
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
        rows = self.rows
        R = _with_attitude_noise(rows.R, rows.y, rows.shares, rows.axis, rows.is_wing, self.axes, noise_c)
        return self._replace(rows=rows._replace(R=R))


class Layout(NamedTuple):
    """Points, shares and axes of rows (`Rows`)."""

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
    """Measure a wing by image points, center, left and right with standard deviations, all in focal lengths;
    with its `middle` if that is to be measured."""
    axes, layout = axes_about(points[0]), WING_AND_MIDDLE if middle else OF_WING
    y, R = _measured(axes, np.array(points, float), np.array(sigmas, float), *layout)
    (a, b), ((aa, ab), (_, bb)) = y[WING].tolist(), R[WING, WING].tolist()
    span, along = math.hypot(a, b), max(a * a * aa + 2 * a * b * ab + b * b * bb, 0.0)
    sigma = math.sqrt(along) / span if span > 0 else math.sqrt(aa)
    return Measurement(Rows(y, R, WING_POINTS, *layout, is_wing=True), span, sigma, axes)


def measure_direction(point: ImagePoint, sigma: float) -> Measurement:
    """Measure a direction by one image point."""
    axes = axes_about(point)
    y, R = _measured(axes, np.array([point], float), np.array([sigma], float), *OF_DIRECTION)
    return Measurement(Rows(y, R, CENTER, *OF_DIRECTION), 1.0, math.inf, axes)


def rows_of_points(axes: Array, known: Sequence[tuple[str, Array, ImagePoint, float]], posture: Posture) -> Rows:
    """The rows of points of a body, each with its name, its place (3,) in b, and where and how exactly it was
    seen."""
    names, places, seen, sigmas = zip(*known, strict=True)
    y = coordinates(axes, seen)
    k = len(known)
    of: Any = np.repeat(np.arange(k), 4).reshape(-1, 2)
    layout = Layout(of, np.tile([1.0, 0.0], (2 * k, 1)), np.tile(BOTH_AXES, k))
    R = np.diag(np.repeat(np.square(sigmas), 2))
    return Rows(y.ravel(), R, np.array(places), *layout, names=tuple(names), posture=posture)


def rows_of_box(axes: Array, sides: Sequence[ImagePoint], share: float, shape: Shape) -> Rows:
    """The rows of a box, by the middles of its left, upper, right and lower side, each with noise of this `share`
    of the larger one."""
    at = coordinates(axes, sides)
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


def coordinates(axes: Array, points: Sequence[ImagePoint]) -> Array:
    """Stereographic coordinates (k, 2) of image points about the first of `axes`."""
    at: Array = _coordinates(axes, np.array(points, float))[0]
    return at


@kernel((OUT, OUT), **MAKING)
def _coordinates(axes, points):
    """`coordinates`, and their derivatives (k, 2, 2) by those of the points."""
    at, by = np.empty(points.shape), np.empty((points.shape[0], 2, 2))
    for k in range(points.shape[0]):
        u, v = points[k]
        length = np.sqrt(1.0 + u * u + v * v)
        below = length + (axes[0, 0] + u * axes[0, 1] + v * axes[0, 2])
        for a in range(2):
            e = axes[1 + a]
            at[k, a] = 2.0 * (e[0] + u * e[1] + v * e[2]) / below
            for j in range(2):
                by[k, a, j] = (2.0 * e[1 + j] - at[k, a] * (points[k, j] / length + axes[0, 1 + j])) / below
    return at, by


@kernel((OUT, OUT, VECTOR, array(INT, 2), ROWS, INDICES), **MAKING)
def _measured(axes, points, sigmas, of, shares, axis):
    """Return the rows (m,) of image points with these standard deviations, and their noise (m, m)."""
    at, by_points = _coordinates(axes, points)
    m, k = axis.shape[0], points.shape[0]
    y, R = np.zeros(m), np.zeros((m, m))
    by = np.zeros((m, 2 * k))  # of the rows, by the coordinates of each point on the image
    for i in range(m):
        for side in range(2):
            point, share = of[i, side], shares[i, side]
            y[i] += share * at[point, axis[i]]
            for j in range(2):
                by[i, 2 * point + j] += share * by_points[point, axis[i], j] * sigmas[point]
        for j in range(i + 1):
            for n in range(2 * k):
                R[i, j] += by[i, n] * by[j, n]
            R[j, i] = R[i, j]
    return y, R


@kernel((ROWS, VECTOR, ROWS, INDICES, BOOL, ROWS, ROWS), **MAKING)
def _with_attitude_noise(R, y, shares, axis, is_wing, axes, noise_c):
    """See `Measurement.with_attitude_noise`."""
    m = axis.shape[0]
    by = np.empty((m, 3))
    for i in range(m):
        share = shares[i, 0] + shares[i, 1]
        for n in range(3):
            by[i, n] = share * (axes[2, n] if axis[i] == 0 else -axes[1, n])
            if is_wing and 2 <= i < 4:
                by[i, n] = (-y[3] if i == 2 else y[2]) * axes[0, n]
    found = np.empty((m, m))
    for i in range(m):
        for j in range(m):
            found[i, j] = R[i, j]
            for a in range(3):
                for b in range(3):
                    found[i, j] += by[i, a] * noise_c[a, b] * by[j, b]
    return found


def points_of(axes: Array, y: Array) -> tuple[ImagePoint, ...]:
    """Image points of a measurement y (m,) with a wing about `axes` (3, 3), in focal lengths.

    Center, left and right wingtip, as if the center were the wing's middle; of a direction the center alone. NaN
    for a point behind the camera."""
    rows, (right, down, *wing) = axes.T.tolist(), y.tolist()
    found = []
    for half in (0.0, -0.5, 0.5) if wing else (0.0,):
        u, v = (right + half * wing[0], down + half * wing[1]) if wing else (right, down)
        along = 1.0 - 0.25 * (u * u + v * v)
        ahead, aside, below = (along * line + u * e + v * f for line, e, f in rows)
        found.append((aside / ahead, below / ahead) if ahead > 0.0 else (math.nan, math.nan))
    return tuple(found)


def measured_spread(rows: Rows, y: Array) -> Array:
    """Return the spread of the coordinates (..., m) of points, or those of a box's sides, root of the sum of
    squares."""
    if rows.is_box:
        return np.asarray(np.sqrt(0.5 * np.add.reduce(y[..., WING] ** 2, axis=-1)))
    total = np.zeros(y.shape[:-1])
    for axis in BOTH_AXES:
        of_axis = y[..., rows.axis == axis]
        total += np.sum((of_axis - of_axis.mean(axis=-1, keepdims=True)) ** 2, axis=-1)
    return np.sqrt(total)
