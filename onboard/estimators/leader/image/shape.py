"""The shape of a class of targets: where its points are, and what bounds it."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.config import Config

WINGTIPS: Final = ((0.0, -0.5, 0.0), (0.0, 0.5, 0.0))  # in b, of a wingspan of 1
ROTORS: Final[Mapping[str, int]] = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8}


class Posture(NamedTuple):
    """Pitch and proportions of a leader.

    `tilts` is 1 if it pitches to accelerate, else 0; the standard deviation of its pitch about that, rad; and that
    of a point's place, as a share of the wingspan."""

    tilts: float
    pitch: float
    place_sigma: float


RIGID: Final = Posture(0.0, 0.0, 0.0)  # of a wing, whose tips are where they are


class Shape(NamedTuple):
    """Shape of a class of targets; points in b for a wingspan of 1."""

    names: tuple[str, ...]  # of points that tell one side of the aircraft from the other
    points: Array  # (k, 3)
    bounds: Array  # (j, 3) what a box bounds
    box_bias: float  # of a box's size, one standard deviation
    edge_on_visibility: float  # of the wing's length: what the edge-on aircraft shows
    posture: Posture  # how it tilts
    size: float = 2.0  # m, the wingspan
    pose_bias: float = 0.0  # of the range of poses, one standard deviation
    height: float = 0.0  # of the wingspan: how well top and bottom are known
    center_on_wing: bool = False  # an image measures the wing's middle, too


class Outline(NamedTuple):
    """The outline that boxes bound."""

    bounds: Array  # (j, 3) in b, for a wingspan of 1
    bias: float  # of a box's size, one standard deviation
    height: float = 0.0  # of the wingspan: how well top and bottom are known


def shape_of(config: Config) -> Shape:
    """The shape of a class of targets."""
    body = [tuple(x / config.size_prior_m for x in point) for point in config.points_m.values()]
    tips = ("left", "right") if config.named_wingtips else ()
    names = *config.points_m, *tips
    points = np.array([*body, *WINGTIPS[: len(tips)]]).reshape(-1, 3)
    outline = outline_of(config)
    edge_on_visibility = min(max(float(np.ptp(outline.bounds[:, 0])), 0.1), 1.0)
    tilts = 1.0 if config.leader_class == "multirotor" else 0.0
    posture = Posture(tilts, given.PITCH, given.KEYPOINT_SIGMA_RATIO)
    size, pose = config.size_prior_m, config.pose_scale_sigma
    known = names, points, outline.bounds, outline.bias, edge_on_visibility, posture, size, pose, outline.height
    return Shape(*known, config.center_on_wing)


def outline_of(config: Config) -> Outline:
    """Return the outline of a class: its `aircraft` in usual proportions.

    If that is not set, its points, with a wing or without; if it has no points either, a quadrotor for a
    multirotor, and else a fixed wing."""
    aircraft = config.aircraft
    if aircraft is None and config.points_m:
        points = np.array([*config.points_m.values()]) / config.size_prior_m
        return Outline(np.array([*(WINGTIPS if config.wings else ()), *points, *given.THICKNESS]), given.BOX_BIAS)
    if aircraft is None:
        aircraft = "quadrotor" if config.leader_class == "multirotor" else "fixed-wing"
    if aircraft in ROTORS:
        return Outline(_rotors(ROTORS[aircraft]), given.BOX_BIAS, given.CANOPY_AND_FEET_SIGMA)
    return Outline(np.array([*WINGTIPS, *given.FUSELAGE, *given.THICKNESS]), given.GENERIC_BOX_BIAS)


def _rotors(count: int) -> Array:
    """Return the outline (j, 3) of a multirotor in b, 1 wide across its rotors, none in front: the outer
    part of each rim, and canopy and feet."""
    rotors = math.tau * (np.arange(count) + 0.5)[:, None] / count
    rims = rotors + math.pi / count * np.linspace(-1.0, 1.0, 2 + given.RIM_POINT_COUNT // count)
    radius = given.ROTOR_RADIUS_RATIO * math.sin(math.pi / count)  # of a rotor, on a circle of radius 1
    x, y = (f(rotors) + radius * f(rims) for f in (np.cos, np.sin))
    ring = np.stack([x, y], axis=2).reshape(-1, 2) / np.ptp(y)
    return np.vstack(
        [np.column_stack([ring, np.full(len(ring), given.ROTOR_PLANE_HEIGHT)]), given.CANOPY_AND_FEET]
    )
