"""The shape of a leader beyond its wing, and the box that a detector draws around it, with their errors."""

import math
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.messages import ImagePoint, Quaternion, Vec3
from simlink.scenarios.camera import Camera, lens_of
from simlink.scenarios.formation import NAMED_POINTS
from simlink.sensors.arrays import Array
from simlink.sensors.camera import in_camera
from simlink.world import attitude
from simlink.world.drawn import Range


class Place(NamedTuple):
    """Where a leader of wingspan `size` (m) is, as seen by a camera with this mount on a follower."""

    size: float
    r_FL_n: Vec3
    q_nL: Quaternion
    q_nF: Quaternion
    camera: Camera
    q_bc: Quaternion


MISPLACED: Final = 0.02  # wingspans, along each axis: how far the true points are from those that are known
TOP: Final[Range] = (0.03, 0.12)  # wingspans, of a fin or a canopy above the center
BOTTOM: Final[Range] = (0.02, 0.08)
# Quadrotors from a 5-inch racer to a Matrice 350, by their data sheets: a rotor's radius over half the distance to
# its neighbour is 0.72 (X500) to 0.97 (Phantom 4), and all of it is 0.2 to 0.45 of the width high. A Mavic is less
# long than wide; others are square.
ROTOR: Final[Range] = (0.65, 1.0)  # radius, of half the distance between two rotors side by side
LENGTH: Final[Range] = (0.85, 1.15)  # of the distance between two rotors side by side: from front to rear rotor
ROTORS_TOP: Final[Range] = (0.04, 0.15)  # widths, above the center
ROTORS_BOTTOM: Final[Range] = (0.08, 0.30)  # the same below it, to the feet
RIM: Final = 16  # points of a rotor's rim
# Detectors place the sides of a box to some percent of it, with a bias: 0.05 of its size still counts as nearly
# right among the usual scores (an overlap of 0.9).
BOX_BIAS: Final = 0.05  # of the box's size
BOX_NOISE: Final[Range] = (0.02, 0.05)  # of its larger side, each side


class Shape(NamedTuple):
    """Of one leader, in b for a wingspan of 1: its nose and tail, and how far it reaches up and down; how much too
    large boxes around it are by their bias, and their noise."""

    named: Mapping[str, Vec3]
    bounds: tuple[Vec3, ...]
    too_large: float
    noise: float


def draw_shape(rng: np.random.Generator) -> Shape:
    """The shape of one leader."""
    named = {name: _near(point, rng) for name, point in NAMED_POINTS.items()}
    top, bottom = -float(rng.uniform(*TOP)), float(rng.uniform(*BOTTOM))
    wing: tuple[Vec3, ...] = (0.0, -0.5, 0.0), (0.0, 0.5, 0.0)
    bounds = *wing, *named.values(), (0.0, 0.0, top), (0.0, 0.0, bottom)
    return Shape(named, bounds, float(rng.normal(0.0, BOX_BIAS)), float(rng.uniform(*BOX_NOISE)))


def draw_rotors(rng: np.random.Generator) -> tuple[Vec3, ...]:
    """What bounds one quadrotor, in b, of width 1 across its rotors: their rims, its top and its feet."""
    rotor, length = float(rng.uniform(*ROTOR)), float(rng.uniform(*LENGTH))
    top, bottom = -float(rng.uniform(*ROTORS_TOP)), float(rng.uniform(*ROTORS_BOTTOM))
    height = float(rng.uniform(top, 0.0))
    arm = 0.5 / (1.0 + rotor)
    rims = tuple(
        (
            arm * (ahead * length + rotor * math.cos(math.tau * k / RIM)),
            arm * (aside + rotor * math.sin(math.tau * k / RIM)),
            height,
        )
        for ahead in (-1.0, 1.0)
        for aside in (-1.0, 1.0)
        for k in range(RIM)
    )
    return *rims, (0.0, 0.0, top), (0.0, 0.0, bottom)


def _near(point: Vec3, rng: np.random.Generator) -> Vec3:
    x, y, z = (np.array(point) + MISPLACED * rng.standard_normal(3)).tolist()
    return x, y, z


def projected(points: Iterable[Vec3], place: Place) -> list[ImagePoint]:
    """Image points of a leader's points, in b for a wingspan of 1."""
    size, r_FL_n, q_nL, q_nF, camera, q_bc = place
    found, lens = [], lens_of(camera)
    for px, py, pz in points:
        x, y, z = attitude.to_n(q_nL, (size * px, size * py, size * pz))
        ahead, right, down = in_camera((r_FL_n[0] + x, r_FL_n[1] + y, r_FL_n[2] + z), q_nF, camera, q_bc)
        found.append(lens.pixel(right / ahead, down / ahead))
    return found


def box_around(points: list[ImagePoint], shape: Shape, noise: Array) -> tuple[ImagePoint, ImagePoint]:
    """Middle and half sides of the box that a detector draws around image points; `noise` (4,) is standard
    normal."""
    (left, upper), (right, lower) = np.min(points, axis=0).tolist(), np.max(points, axis=0).tolist()
    a, b = 0.5 * (1.0 + shape.too_large) * (right - left), 0.5 * (1.0 + shape.too_large) * (lower - upper)
    off = (shape.noise * 2.0 * max(a, b) * noise).tolist()
    u, v = 0.5 * (left + right) + 0.5 * (off[0] + off[1]), 0.5 * (upper + lower) + 0.5 * (off[2] + off[3])
    least = 0.1 * max(a, b)
    return (u, v), (max(a + 0.5 * (off[1] - off[0]), least), max(b + 0.5 * (off[3] - off[2]), least))
