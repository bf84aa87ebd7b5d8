"""The shape of a class of targets, and what a detection shows of it: rows of `hypotheses.points`."""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import (
    BOX_BIAS,
    FUSELAGE,
    GUESS_BIAS,
    MISPLACED,
    PITCH,
    ROTOR,
    ROTORS_AT,
    ROTORS_BIAS,
    ROTORS_HEIGHT,
    ROTORS_HIGH,
    THICKNESS,
)
from onboard.estimators.leader.config import Config
from onboard.messages import ImageFeature, ImagePoint, Sides

LOWEST: Final = -1.0  # in place of a point's number: the point with the least coordinate ...
HIGHEST: Final = -2.0  # ... and the one with the largest
WINGTIPS: Final = ((0.0, -0.5, 0.0), (0.0, 0.5, 0.0))  # in b, of a wingspan of 1
ROTORS: Final[Mapping[str, int]] = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8}
RIM: Final = 12  # points of the circle that stands for all rotors
SMALLEST: Final = 2.0  # a spread below this many of its sigmas says nothing of the range
SHORTEST: Final = 0.1  # of the wingspan, from nose to tail: closer points show no nose


# Of a box, from its left, right, upper and lower side.
MIDDLE_AND_SIZE: Final = np.array([[0.5, 0.5, 0, 0], [0, 0, 0.5, 0.5], [-1.0, 1.0, 0, 0], [0, 0, -1.0, 1.0]])


class ShapeRows(NamedTuple):
    """What is seen of a shape: its points (k, 3) in b; for each row (m,) the point's number, LOWEST or HIGHEST;
    the axis, 0 right or 1 down; the coordinate and its standard deviation, rad. `named`: whether a point's name
    tells the nose from the tail."""

    points: Array
    which: Array
    axis: Array
    y: Array
    sigma: Array
    named: bool


class Posture(NamedTuple):
    """How a leader holds itself: `leans` is 1 if it pitches to accelerate, else 0; the standard deviation of its
    pitch about that, rad; and that of a point's place, as a share of the wingspan."""

    leans: float
    pitch: float
    misplaced: float


class Shape(NamedTuple):
    """Of a class of targets; points in b for a wingspan of 1."""

    names: tuple[str, ...]  # of points that tell one side of the aircraft from the other
    points: Array  # (k, 3)
    bounds: Array  # (j, 3) what a box bounds
    box_bias: float  # of a box's size, one standard deviation
    edge_on: float  # of the wing's length: what the edge-on aircraft shows
    posture: Posture  # how it leans
    size: float = 2.0  # m, the wingspan
    pose_bias: float = 0.0  # of the range of poses, one standard deviation
    height: float = 0.0  # of the wingspan: how well top and bottom are known
    center_on_wing: bool = False  # an image measures the wing's middle, too


class Outline(NamedTuple):
    """What boxes bound."""

    bounds: Array  # (j, 3) in b, for a wingspan of 1
    bias: float  # of a box's size, one standard deviation
    height: float = 0.0  # of the wingspan: how well top and bottom are known


class ShapeFeatures(NamedTuple):
    """What a detection shows beyond center and wing."""

    rows: ShapeRows
    extent: ShapeRows  # the same with the center, if that was seen
    spread: float  # rad, standard deviation of the extent's coordinates ...
    spread_sigma: float  # ... and the noise of that
    bias: float  # of the size, one standard deviation
    edge_on: float  # of the wing's length: what the edge-on aircraft shows
    posture: Posture  # how it leans
    is_box: bool  # the rows are a box's sides
    misplaced: float = 0.0  # of the length between nose and tail: the bias of named points
    names: tuple[str, ...] = ()  # of the points, two rows each; none of a box

    @property
    def has_extent(self) -> bool:
        """Whether the spread is more than noise, so that it says something of the range."""
        return self.spread > SMALLEST * self.spread_sigma


def shape_of(config: Config) -> Shape:
    """The shape of a class of targets."""
    body = [tuple(x / config.size_prior_m for x in point) for point in config.points_m.values()]
    tips = ("left", "right") if config.named_wingtips else ()
    names = *config.points_m, *tips
    points = np.array([*body, *WINGTIPS[: len(tips)]]).reshape(-1, 3)
    outline = outline_of(config)
    edge_on = min(max(float(np.ptp(outline.bounds[:, 0])), 0.1), 1.0)
    leans = 1.0 if config.leader_class == "multirotor" else 0.0
    posture = Posture(leans, PITCH, MISPLACED)
    size, pose = config.size_prior_m, config.pose_scale_sigma
    known = names, points, outline.bounds, outline.bias, edge_on, posture, size, pose, outline.height
    return Shape(*known, config.center_on_wing)


def outline_of(config: Config) -> Outline:
    """What boxes of a class bound: its `aircraft` in usual proportions. If that is not set, its points, with a
    wing or without; if it has no points either, a quadrotor for a multirotor, and else a fixed wing."""
    aircraft = config.aircraft
    if aircraft is None and config.points_m:
        points = np.array([*config.points_m.values()]) / config.size_prior_m
        return Outline(np.array([*(WINGTIPS if config.wings else ()), *points, *THICKNESS]), BOX_BIAS)
    if aircraft is None:
        aircraft = "quadrotor" if config.leader_class == "multirotor" else "fixed-wing"
    if aircraft in ROTORS:
        return Outline(_rotors(ROTORS[aircraft]), ROTORS_BIAS, ROTORS_HEIGHT)
    return Outline(np.array([*WINGTIPS, *FUSELAGE, *THICKNESS]), GUESS_BIAS)


def _rotors(count: int) -> Array:
    """What bounds a multirotor (j, 3) in b that is 1 wide across its rotors, none of which is in front: a circle
    as wide as they are on average, and canopy and feet. By Cauchy's theorem the mean width is the perimeter of
    the hull over pi. With the rotors themselves, particles agreed on one width, and so on a nose, for no reason.
    """
    side = math.sin(math.pi / count)  # half the distance between two rotors, on a circle of radius 1
    perimeter = 2.0 * count * side + math.tau * ROTOR * side
    aside = np.sin(math.tau * (np.arange(count) + 0.5) / count).max() + ROTOR * side
    at = math.tau * np.arange(RIM) / RIM
    radius = perimeter / (2.0 * aside) / (2.0 * RIM * math.sin(math.pi / RIM))  # of a polygon with this perimeter
    ring = np.column_stack([radius * np.cos(at), radius * np.sin(at), np.full(RIM, ROTORS_AT)])
    return np.vstack([ring, ROTORS_HIGH])


def of_points(
    shape: Shape, features: Sequence[ImageFeature], axes: Array, *, has_center: bool
) -> ShapeFeatures | None:
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
    return ShapeFeatures(rows, extent, spread, sigma, 0.0, shape.edge_on, shape.posture, False, misplaced, names)


def only(shows: ShapeFeatures, which: Sequence[int]) -> ShapeFeatures:
    """What some of the named points show."""
    rows, at = shows.rows, np.array([2 * k + axis for k in which for axis in (0, 1)])
    index = np.repeat(np.arange(float(len(which))), 2)
    rows = rows._replace(
        points=rows.points[list(which)], which=index, axis=rows.axis[at], y=rows.y[at], sigma=rows.sigma[at]
    )
    return shows._replace(rows=rows, names=tuple(shows.names[k] for k in which))


def _of_points(points: Array, y: Array, sigmas: Sequence[float]) -> ShapeRows:
    which, axis = np.repeat(np.arange(float(len(points))), 2), np.tile([0.0, 1.0], len(points))
    return ShapeRows(points, which, axis, y.ravel(), np.repeat(sigmas, 2), named=True)


def of_box(shape: Shape, sides: Sides, noise: float, axes: Array) -> ShapeFeatures:
    """What the `sides` of a box bound, each with this `noise`, in shares of the larger one."""
    left, upper, right, lower = (_on_plane(axes, side)[k % 2] for k, side in enumerate(sides))
    larger = max(right - left, lower - upper)
    sigma = np.full(4, noise * larger)
    sigma[2:] = np.hypot(sigma[2:], shape.height * larger)
    which, axis = np.array([LOWEST, HIGHEST] * 2), np.array([0.0, 0.0, 1.0, 1.0])
    rows = ShapeRows(shape.bounds, which, axis, np.array([left, right, upper, lower]), sigma, named=False)
    spread = float(measured_spread(rows, rows.y))
    return ShapeFeatures(
        rows, rows, spread, float(sigma[0]), shape.box_bias, shape.edge_on, shape.posture, is_box=True
    )


def _on_plane(axes: Array, point: ImagePoint) -> tuple[float, float]:
    """A point's coordinates as in `measurement`."""
    direction = np.array([1.0, *point])
    ahead, right, down = (axes @ direction).tolist()
    twice = 2.0 / (float(np.linalg.norm(direction)) + ahead)
    return twice * right, twice * down


def measured_spread(rows: ShapeRows, y: Array) -> Array:
    """How far the rows' coordinates (..., m) are apart, root of the sum of squares."""
    total = np.zeros(y.shape[:-1])
    for axis in (0.0, 1.0):
        of_axis = y[..., rows.axis == axis]
        total += np.sum((of_axis - of_axis.mean(axis=-1, keepdims=True)) ** 2, axis=-1)
    return np.sqrt(total)
