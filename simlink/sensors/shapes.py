"""The shape of a leader beyond its wing, the box around it, and their errors."""

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
    """A leader of wingspan `size` (m), and the follower and camera that observe it."""

    size: float
    r_FL_n: Vec3
    q_nL: Quaternion
    q_nF: Quaternion
    camera: Camera
    q_bc: Quaternion


POINT_ERROR: Final = 0.02  # wingspans, along each axis: true minus configured points
TOP_HEIGHT: Final[Range] = (0.03, 0.12)  # wingspans, of a fin or a canopy above the center
BOTTOM_DEPTH: Final[Range] = (0.02, 0.08)
# Quadrotors from a 5-inch racer to a Matrice 350, by their data sheets: a rotor's radius over half the distance to
# its neighbour is 0.72 (X500) to 0.97 (Phantom 4), and all of it is 0.2 to 0.45 of the width high. A Mavic is less
# long than wide; others are square.
ROTOR_RADIUS: Final[Range] = (0.65, 1.0)  # over half the distance between two rotors side by side
LENGTH_RATIO: Final[Range] = (0.85, 1.15)  # front to rear rotor, over the distance between two rotors side by side
QUADROTOR_TOP_HEIGHT: Final[Range] = (0.04, 0.15)  # widths, above the center
QUADROTOR_BOTTOM_DEPTH: Final[Range] = (0.08, 0.30)  # widths, below the center, to the feet
RIM_SAMPLES: Final = 16  # points of a rotor's rim
# Detectors place the sides of a box to some percent of it, with a bias: 0.05 of its size still counts as nearly
# right among the usual scores (an overlap of 0.9).
BOX_BIAS: Final = 0.05  # of the box's size
BOX_NOISE: Final[Range] = (0.02, 0.05)  # of its larger side, each side


class Shape(NamedTuple):
    """The shape of one leader in b, for a wingspan of 1, and the errors of boxes around it."""

    named: Mapping[str, Vec3]  # nose and tail
    bounds: tuple[Vec3, ...]  # the outermost points, up and down among them
    box_bias: float  # share by which boxes are too large
    box_noise: float  # share of the larger side


def draw_shape(rng: np.random.Generator) -> Shape:
    """Draw the shape of one leader."""
    named = {name: _perturb(point, rng) for name, point in NAMED_POINTS.items()}
    top, bottom = -float(rng.uniform(*TOP_HEIGHT)), float(rng.uniform(*BOTTOM_DEPTH))
    wing: tuple[Vec3, ...] = (0.0, -0.5, 0.0), (0.0, 0.5, 0.0)
    bounds = *wing, *named.values(), (0.0, 0.0, top), (0.0, 0.0, bottom)
    return Shape(named, bounds, float(rng.normal(0.0, BOX_BIAS)), float(rng.uniform(*BOX_NOISE)))


def draw_rotors(rng: np.random.Generator) -> tuple[Vec3, ...]:
    """Draw the points in b that bound a quadrotor with a width of 1 across its rotors.

    They are the rims of its rotors, its top and its feet.
    """
    rotor, length = float(rng.uniform(*ROTOR_RADIUS)), float(rng.uniform(*LENGTH_RATIO))
    top, bottom = -float(rng.uniform(*QUADROTOR_TOP_HEIGHT)), float(rng.uniform(*QUADROTOR_BOTTOM_DEPTH))
    height = float(rng.uniform(top, 0.0))
    arm = 0.5 / (1.0 + rotor)
    rims = tuple(
        (
            arm * (ahead * length + rotor * math.cos(math.tau * k / RIM_SAMPLES)),
            arm * (aside + rotor * math.sin(math.tau * k / RIM_SAMPLES)),
            height,
        )
        for ahead in (-1.0, 1.0)
        for aside in (-1.0, 1.0)
        for k in range(RIM_SAMPLES)
    )
    return *rims, (0.0, 0.0, top), (0.0, 0.0, bottom)


def _perturb(point: Vec3, rng: np.random.Generator) -> Vec3:
    x, y, z = (np.array(point) + POINT_ERROR * rng.standard_normal(3)).tolist()
    return x, y, z


def project_points(points: Iterable[Vec3], place: Place) -> list[ImagePoint]:
    """Project a leader's points, in b for a wingspan of 1, into the image."""
    size, r_FL_n, q_nL, q_nF, camera, q_bc = place
    found, lens = [], lens_of(camera)
    for px, py, pz in points:
        x, y, z = attitude.to_n(q_nL, (size * px, size * py, size * pz))
        ahead, right, down = in_camera((r_FL_n[0] + x, r_FL_n[1] + y, r_FL_n[2] + z), q_nF, camera, q_bc)
        found.append(lens.pixel(right / ahead, down / ahead))
    return found


def box_around(points: list[ImagePoint], shape: Shape, noise: Array) -> tuple[ImagePoint, ImagePoint]:
    """Return the centre and half sides of the box that a detector draws around image points.

    `noise` (4,) is standard normal.
    """
    (left, upper), (right, lower) = np.min(points, axis=0).tolist(), np.max(points, axis=0).tolist()
    a, b = 0.5 * (1.0 + shape.box_bias) * (right - left), 0.5 * (1.0 + shape.box_bias) * (lower - upper)
    off = (shape.box_noise * 2.0 * max(a, b) * noise).tolist()
    u, v = 0.5 * (left + right) + 0.5 * (off[0] + off[1]), 0.5 * (upper + lower) + 0.5 * (off[2] + off[3])
    least = 0.1 * max(a, b)
    return (u, v), (max(a + 0.5 * (off[1] - off[0]), least), max(b + 0.5 * (off[3] - off[2]), least))
