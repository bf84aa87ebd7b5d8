"""Shapes as triangles and lines in body axes (FRD), in metres for a span of one metre."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array


class Mesh(NamedTuple):
    """Triangles with vertices (3 n, 3), none shared, and their normals (3 n, 3)."""

    vertices: Array
    normals: Array


def flat_mesh(triangles: ArrayLike) -> Mesh:
    """Return the mesh of triangles (n, 3, 3) with one normal each, so that edges look sharp."""
    t = np.asarray(triangles, dtype=float)
    normals = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Mesh(vertices=t.reshape(-1, 3), normals=np.repeat(normals, 3, axis=0))


def merge(*meshes: Mesh) -> Mesh:
    """Join several meshes."""
    return Mesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        normals=np.concatenate([m.normals for m in meshes]),
    )


def plate(outline: ArrayLike, thickness: ArrayLike) -> Mesh:
    """Thicken a convex polygon (n, 3) by the vector `thickness` (3,), half to either side."""
    points, half = np.asarray(outline, dtype=float), np.asarray(thickness, dtype=float) / 2
    top, bottom = points + half, points - half
    n = len(points)
    triangles = [[top[0], top[i], top[i + 1]] for i in range(1, n - 1)]
    triangles += [[bottom[0], bottom[i + 1], bottom[i]] for i in range(1, n - 1)]
    for i in range(n):
        j = (i + 1) % n
        triangles += [[top[i], bottom[i], bottom[j]], [top[i], bottom[j], top[j]]]
    return flat_mesh(np.array(triangles))


def spindle(x: ArrayLike, radius: ArrayLike, sides: int = 10) -> Mesh:
    """Return a body of revolution about the forward axis: radii (n,) at stations x (n,)."""
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    rings = [np.array([a, 0, 0]) + r * ring for a, r in zip(np.asarray(x), np.asarray(radius), strict=True)]
    triangles = []
    for front, back in pairwise(rings):
        for i in range(sides):
            triangles += [[front[i], back[i], back[i + 1]], [front[i], back[i + 1], front[i + 1]]]
    return flat_mesh(np.array(triangles))


WING_OUTLINE = [(0.07, 0, 0), (-0.04, 0.5, 0), (-0.12, 0.5, 0), (-0.15, 0, 0), (-0.12, -0.5, 0), (-0.04, -0.5, 0)]
TAILPLANE = [(-0.42, 0, 0), (-0.48, 0.19, 0), (-0.54, 0.19, 0), (-0.54, -0.19, 0), (-0.48, -0.19, 0)]
FIN = [(-0.38, 0, 0), (-0.5, 0, -0.18), (-0.56, 0, -0.18), (-0.54, 0, 0)]


def aeroplane() -> Mesh:
    """Return a fixed-wing aircraft of span 1, its origin at the middle of the wing."""
    return merge(
        plate(WING_OUTLINE, (0, 0, 0.025)),
        plate(TAILPLANE, (0, 0, 0.02)),
        plate(FIN, (0, 0.02, 0)),
        spindle([0.42, 0.38, 0.25, 0.05, -0.2, -0.55], [0.0, 0.035, 0.06, 0.065, 0.045, 0.012]),
    )


def aeroplane_outline() -> list[Array]:
    """Return line strips of the same aircraft, to lay over it."""
    closed = [np.array([*part, part[0]], dtype=float) for part in (WING_OUTLINE, TAILPLANE, FIN)]
    return [*closed, np.array([(0.42, 0, 0), (-0.55, 0, 0)], dtype=float)]


HUBS = ((0.31, 0.31), (0.31, -0.31), (-0.31, 0.31), (-0.31, -0.31))
DISC_RADIUS = 0.19  # for a span of 1


def hubs(rotors: Sequence[Sequence[float]]) -> Array:
    """Return the positions (n, 2) of rotor hubs in a glyph of span 1; an X if unknown."""
    places = np.array([(x, y) for x, y, *_ in rotors] or HUBS, dtype=float)
    return np.asarray(places * (np.hypot(*HUBS[0]) / np.max(np.hypot(places[:, 0], places[:, 1]))))


def disc(hub: ArrayLike, radius: float = DISC_RADIUS, thickness: float = 0.012) -> Mesh:
    """Return a rotor over its hub (2,), as the disc that it sweeps."""
    angle = np.linspace(0, 2 * np.pi, 17)[:-1]
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    return plate(np.array([*np.asarray(hub), -0.05]) + rim, (0, 0, thickness))


def multirotor(rotors: Sequence[Sequence[float]] = ()) -> Mesh:
    """Return a multirotor of span 1, nose forward, with its rotors; a quadrotor if unknown."""
    parts = [spindle([0.24, 0.18, 0.0, -0.2, -0.24], [0.0, 0.09, 0.11, 0.08, 0.0], sides=8)]
    for x, y in hubs(rotors):
        length = max(float(np.hypot(x, y)), 1e-9)
        hub, across = np.array([x, y, -0.05]), 0.028 / length * np.array([-y, x, 0])
        parts.append(plate([across, hub + across, hub - across, -across], (0, 0, 0.03)))
        parts.append(disc((x, y)))
    return merge(*parts)


def grid(cell: float, cells: int) -> list[Array]:
    """Return the lines of a horizontal grid, `cells` to either side, `cell` metres apart."""
    lines = []
    steps = np.arange(-cells, cells + 1) * cell
    for k in steps:
        # a piece per cell: of a line that ends behind the eye, the viewer draws the near part far too wide
        for a, b in pairwise(steps):
            lines.append(np.array([(k, a, 0), (k, b, 0)], dtype=float))
            lines.append(np.array([(a, k, 0), (b, k, 0)], dtype=float))
    return lines
