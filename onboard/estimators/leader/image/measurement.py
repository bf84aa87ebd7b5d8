"""What an image measures of a leader's wing, without the assumption that the wing lies in the image plane.

Measurement (4): the center's direction and the line from the left wingtip to the right one, as coordinates
(right, down), rad, on the plane tangent to the sphere of directions at the measured center. The projection is
stereographic: smooth everywhere but exactly opposite the center, so a leader predicted behind the camera is not
folded to the front, and for a small wing the coordinates are the angles. Compared with Oh & Johnson's subtended
angle (eq 17) it adds the wing's slope, which shows the bank; the wing's length depends on the leader's heading.

If the center is the middle between the wingtips, as in Oh & Johnson's paper, the middle of the wing's image can
be measured too (6). It measures the direction a second time. And since the nearer half of a wing looks longer,
it shows to which side and how far the wing is turned out of the image plane: the middle moves by a fraction of
half the wing, half the wing over the distance. That is a few percent: a swept wing moves its middle by more.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.estimators.leader.image.pose import PoseFeatures
from onboard.estimators.leader.image.shape import Shape, ShapeFeatures
from onboard.filters.compiled import CUBE, ROWS

M: Final = 4
M_MIDDLE: Final = 6  # with the wing's middle
COMPONENTS: Final = ("right", "down", "wing_right", "wing_down", "middle_right", "middle_down")
UNITS: Final = ("rad",) * M_MIDDLE
WING: Final = slice(2, 4)  # of the measurement: from wingtip to wingtip


class Measurement(NamedTuple):
    """Of one image."""

    y: Array  # (m,)
    R: Array  # (m, m) its noise
    span: float  # rad, of the wing; where it was not seen, of what was, or by a pose that of the wing broadside
    span_sigma: float  # rad; infinite if nothing shows the range
    axes: Array  # (3, 3) unit vectors in c: to the center, and the two along which the wing is measured
    shows: ShapeFeatures | None = None  # beyond center and wing
    has_wing: bool = True  # it was seen
    pose: PoseFeatures | None = None
    is_metric: bool = False  # a pose alone shows the range, which does not depend on the size

    def with_attitude_noise(self, noise_c: Array) -> "Measurement":
        """The measurement by a camera whose attitude has white noise, a small rotation in c of covariance noise_c
        (3, 3): all directions move together, and the wing turns about them. The sides of a box move together, too;
        each is as uncertain as if it moved alone."""
        if not np.logical_or.reduce(noise_c, axis=None):
            return self
        by = np.zeros((len(self.y), 3))  # by how much a rotation changes y
        by[0], by[1] = self.axes[2], -self.axes[1]
        by[2], by[3] = -self.y[3] * self.axes[0], self.y[2] * self.axes[0]
        by[4:] = by[: len(self.y) - 4]  # the wing's middle as the center
        noise, shows = by @ noise_c @ by.T, self.shows
        if shows is not None and shows.is_box:
            sigma = np.sqrt(shows.rows.sigma**2 + noise.diagonal()[shows.rows.axis.astype(int)])
            shows = shows._replace(rows=shows.rows._replace(sigma=sigma))
        return self._replace(R=self.R + noise, shows=shows)

    @property
    def noise(self) -> float:
        """The variance of each coordinate of a box's middle by its sides' noise; 0 of a wing, whose tips may be
        noisier than its center."""
        if self.shows is not None and self.shows.is_box:
            return 0.5 * float(self.shows.rows.sigma[0] ** 2)
        return 0.0

    @property
    def has_extent(self) -> bool:
        """Whether it says something of the range."""
        return math.isfinite(self.span_sigma)


def size_of(shape: Shape) -> int:
    """How many numbers an image measures of a wing."""
    return M_MIDDLE if shape.center_on_wing else M


def measure_wing(points: Array, sigmas: Array, shape: Shape) -> Measurement:
    """The measurement (m,) of image points (3, 2), center, left and right, with standard deviations (3,), all in
    focal lengths."""
    y, R, axes = from_points(points[None], sigmas[None], size_of(shape))
    (a, b), ((aa, ab), (_, bb)) = y[0, WING].tolist(), R[0, WING, WING].tolist()
    span = math.hypot(a, b)
    along = max(a * a * aa + 2 * a * b * ab + b * b * bb, 0.0)
    return Measurement(y[0], R[0], span, math.sqrt(along) / span if span > 0 else math.sqrt(aa), axes[0])


def points_of(axes: Array, y: Array) -> Array:
    """Image points (3, 2) of a measurement y (m,) about `axes` (3, 3) (`from_points`), in focal lengths:
    center, left and right wingtip, as if the center were the wing's middle; NaN for a point behind the camera."""
    places = y[:2] + 0.5 * np.array([[0.0], [-1.0], [1.0]]) * y[2:4]
    quarter = 0.25 * np.add.reduce(places**2, axis=1, keepdims=True)
    directions = (1.0 - quarter) * axes[0] + places @ axes[1:]
    ahead = np.where(directions[:, :1] > 0.0, directions[:, :1], np.nan)
    return np.asarray(directions[:, 1:] / ahead)


def from_points(points: Array, sigmas: Array, m: int = M) -> tuple[Array, Array, Array]:
    """Measurements y (B, m), their noise R (B, m, m), and their axes (B, 3, 3) from image
    points (B, 3, 2), center, left and right wingtip, whose coordinates have standard deviations `sigmas` (B, 3).
    Points and sigmas are in focal lengths."""
    y, R, axes = _from_points(points, sigmas, m)
    return y, R, axes


@njit(cache=True, error_model="numpy")
def project_about(axes, x, y, z):
    """Stereographic coordinates (right, down) of the direction of (x, y, z) in c about the first of `axes`."""
    length = np.sqrt(x * x + y * y + z * z)
    ahead = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
    twice = 2.0 / max(length + ahead, 1e-9 * length)
    return (
        twice * (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z),
        twice * (axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z),
    )


@njit((CUBE, ROWS, types.int64), cache=True, error_model="numpy")
def _from_points(points, sigmas, m):
    count = points.shape[0]
    y, R, axes = np.zeros((count, m)), np.zeros((count, m, m)), np.zeros((count, 3, 3))
    for b in range(count):
        u, v = points[b, 0, 0], points[b, 0, 1]
        length, level = np.sqrt(1.0 + u * u + v * v), np.sqrt(1.0 + u * u)
        axes[b, 0, 0], axes[b, 0, 1], axes[b, 0, 2] = 1.0 / length, u / length, v / length
        axes[b, 1, 0], axes[b, 1, 1] = -u / level, 1.0 / level
        axes[b, 2, 0], axes[b, 2, 1] = -v / (length * level), -u * v / (length * level)
        axes[b, 2, 2] = level / length
        for p in range(3):
            u, v = points[b, p, 0], points[b, p, 1]
            at = project_about(axes[b], 1.0, u, v)
            length = np.sqrt(1.0 + u * u + v * v)
            below = length + axes[b, 0, 0] + axes[b, 0, 1] * u + axes[b, 0, 2] * v
            first = 0 if p == 0 else 2
            sign = 1.0 if p == 2 else -1.0
            if p > 0:
                y[b, 2] += sign * at[0]
                y[b, 3] += sign * at[1]
                if m > M:
                    y[b, 4] += 0.5 * at[0]
                    y[b, 5] += 0.5 * at[1]
            # d at / d (u, v), of 2 e.q / (|q| + m.q)
            for i in range(2):
                iu = (2.0 * axes[b, 1 + i, 1] - at[i] * (u / length + axes[b, 0, 1])) / below
                iv = (2.0 * axes[b, 1 + i, 2] - at[i] * (v / length + axes[b, 0, 2])) / below
                for j in range(2):
                    ju = (2.0 * axes[b, 1 + j, 1] - at[j] * (u / length + axes[b, 0, 1])) / below
                    jv = (2.0 * axes[b, 1 + j, 2] - at[j] * (v / length + axes[b, 0, 2])) / below
                    covariance = sigmas[b, p] ** 2 * (iu * ju + iv * jv)
                    R[b, first + i, first + j] += covariance
                    if p > 0 and m > M:
                        R[b, 4 + i, 4 + j] += 0.25 * covariance
                        R[b, 2 + i, 4 + j] += 0.5 * sign * covariance
                        R[b, 4 + i, 2 + j] += 0.5 * sign * covariance
    return y, R, axes
