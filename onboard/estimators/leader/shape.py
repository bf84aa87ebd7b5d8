"""The shape of a class of targets, and what a detection shows of it: rows of `models.apparent_shape`."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.config import Config
from onboard.messages import ImageFeature, ImagePoint
from onboard.models.apparent_shape import HIGHEST, LOWEST, Posture, Rows, measured_spread

WINGTIPS: Final = ((0.0, -0.5, 0.0), (0.0, 0.5, 0.0))  # in b, of a wingspan of 1
# A box also bounds what has no name. Small aircraft are about as long as three quarters of their span, copters as
# long as wide; fuselages are a tenth of it high.
FUSELAGE: Final = ((0.36, 0.0, 0.0), (-0.4, 0.0, 0.0))
THICKNESS: Final = ((0.0, 0.0, -0.07), (0.0, 0.0, 0.05))
BOX_SHARE: Final = 0.05  # of the box's larger side, of each side
LASTING_BOX: Final = 0.08  # of its size: a detector's boxes are lastingly too wide or too narrow ...
LASTING_GUESS: Final = 0.15  # ... and where only the wing is known, so is what they bound
PITCH: Final = math.radians(7.0)  # rad, of the fuselage about the pitch that thrust implies
SMALLEST: Final = 2.0  # a spread below this many of its sigmas says nothing of the range
MISPLACED: Final = 0.03  # of the wingspan: how far a detector misplaces a point of an aircraft
SHORTEST: Final = 0.1  # of the wingspan, from nose to tail: closer points show no nose


class Shape(NamedTuple):
    """Points (k, 3) whose names tell one side of the aircraft from the other, in b for a wingspan of 1; what a box
    bounds (j, 3); by how much of its size a box lastingly misleads; how much of the wing's length the edge-on
    aircraft shows; how it leans; its wingspan, m, and by which share of the range poses lastingly mislead."""

    names: tuple[str, ...]
    points: Array
    bounds: Array
    lasting: float
    edge_on: float
    posture: Posture
    size: float = 2.0
    pose_lasting: float = 0.0


class Seen(NamedTuple):
    """What a detection shows beyond center and wing: its `rows`, and the same with the center, if that was seen
    (`extent`), whose coordinates spread by so much, rad, one standard deviation; by how much of the size they
    lastingly mislead; what an edge-on aircraft shows, and how it leans. `is_box`: the rows are a box's sides.
    `misplaced`: by which share of the length between nose and tail named points are lastingly off. `names`: of the
    points, two rows each; none of a box."""

    rows: Rows
    extent: Rows
    spread: float
    spread_sigma: float
    lasting: float
    edge_on: float
    posture: Posture
    is_box: bool
    misplaced: float = 0.0
    names: tuple[str, ...] = ()

    @property
    def has_extent(self) -> bool:
        """Whether the spread is more than noise, so that it says something of the range."""
        return self.spread > SMALLEST * self.spread_sigma


def shape_of(config: Config) -> Shape:
    """The shape of a class of targets."""
    known = bool(config.points_m)
    body = [tuple(x / config.size_prior_m for x in point) for point in config.points_m.values()]
    tips = ("left", "right") if config.named_wingtips else ()
    names = *config.points_m, *tips
    points = np.array([*body, *WINGTIPS[: len(tips)]]).reshape(-1, 3)
    body = body or list(FUSELAGE)
    bounds = np.array([*(WINGTIPS if config.wings else ()), *body, *THICKNESS])
    edge_on = max(float(np.ptp(bounds[:, 0])), 0.1)
    leans = 1.0 if config.leader_class == "multirotor" else 0.0
    lasting = LASTING_BOX if known else LASTING_GUESS
    posture = Posture(leans, PITCH, MISPLACED)
    return Shape(names, points, bounds, lasting, edge_on, posture, config.size_prior_m, config.pose_scale_sigma)


def of_points(shape: Shape, features: Sequence[ImageFeature], axes: Array, *, has_center: bool) -> Seen | None:
    """What named points of the class show, about the measured `axes`; None if there are none. With `has_center`
    the axes are about the center."""
    known = [f for f in features if f.name in shape.names]
    if not known:
        return None
    points = shape.points[[shape.names.index(f.name) for f in known]]
    y = np.array([_on_plane(axes, f.point) for f in known])
    rows = _of_points(points, y, [f.sigma for f in known])
    extent = rows
    if has_center:
        extent = _of_points(np.vstack([points, np.zeros(3)]), np.vstack([y, np.zeros(2)]), [*rows.sigma[::2], 0.0])
    spread = float(measured_spread(extent, extent.y))
    sigma = math.sqrt(2.0) * float(rows.sigma.max())
    length = float(np.ptp(np.append(points[:, 0], 0.0)))
    misplaced = math.sqrt(2.0) * MISPLACED / length if length > SHORTEST else 0.0
    names = tuple(f.name for f in known)
    return Seen(rows, extent, spread, sigma, 0.0, shape.edge_on, shape.posture, False, misplaced, names)


def only(shows: Seen, which: Sequence[int]) -> Seen:
    """What some of the named points show."""
    rows, at = shows.rows, np.array([2 * k + axis for k in which for axis in (0, 1)])
    index = np.repeat(np.arange(float(len(which))), 2)
    rows = rows._replace(
        points=rows.points[list(which)], which=index, axis=rows.axis[at], y=rows.y[at], sigma=rows.sigma[at]
    )
    return shows._replace(rows=rows, names=tuple(shows.names[k] for k in which))


def _of_points(points: Array, y: Array, sigmas: Sequence[float]) -> Rows:
    which, axis = np.repeat(np.arange(float(len(points))), 2), np.tile([0.0, 1.0], len(points))
    return Rows(points, which, axis, y.ravel(), np.repeat(sigmas, 2), named=True)


def of_box(shape: Shape, middle: ImageFeature, half: ImagePoint, axes: Array) -> Seen:
    """What the sides of a box bound: half its width and height in focal lengths."""
    (u, v), (a, b) = middle.point, half
    left, right = (_on_plane(axes, (u + x, v))[0] for x in (-a, a))
    upper, lower = (_on_plane(axes, (u, v + x))[1] for x in (-b, b))
    larger = max(right - left, lower - upper)
    sigma = np.full(4, max(middle.sigma, BOX_SHARE * larger))
    which, axis = np.array([LOWEST, HIGHEST] * 2), np.array([0.0, 0.0, 1.0, 1.0])
    rows = Rows(shape.bounds, which, axis, np.array([left, right, upper, lower]), sigma, named=False)
    spread = float(measured_spread(rows, rows.y))
    return Seen(rows, rows, spread, float(sigma[0]), shape.lasting, shape.edge_on, shape.posture, is_box=True)


def _on_plane(axes: Array, point: ImagePoint) -> tuple[float, float]:
    """A point's coordinates as in `models.wing_line`."""
    direction = np.array([1.0, *point])
    ahead, right, down = (axes @ direction).tolist()
    twice = 2.0 / (float(np.linalg.norm(direction)) + ahead)
    return twice * right, twice * down
