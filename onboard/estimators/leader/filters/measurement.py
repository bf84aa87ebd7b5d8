"""What an image measures."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.pose import PoseFeatures
from onboard.estimators.leader.shape import ShapeFeatures
from onboard.models import wing_line

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
        if len(self.y) > 3:
            by[2], by[3] = -self.y[3] * self.axes[0], self.y[2] * self.axes[0]
        by[4:] = by[: max(len(self.y) - 4, 0)]  # the wing's middle as the center
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


def measure_wing(points: Array, sigmas: Array, m: int) -> Measurement:
    """The measurement (m,) of image points (3, 2), center, left and right, with standard deviations (3,), all in
    focal lengths."""
    y, R, axes = wing_line.from_points(points[None], sigmas[None], m)
    (a, b), ((aa, ab), (_, bb)) = y[0, WING].tolist(), R[0, WING, WING].tolist()
    span = math.hypot(a, b)
    along = max(a * a * aa + 2 * a * b * ab + b * b * bb, 0.0)
    return Measurement(y[0], R[0], span, math.sqrt(along) / span if span > 0 else math.sqrt(aa), axes[0])


def points_of(axes: Array, y: Array) -> Array:
    """Image points (3, 2) of a measurement y (m,) about `axes` (3, 3) (`models.wing_line`), in focal lengths:
    center, left and right wingtip, as if the center were the wing's middle; NaN for a point behind the camera."""
    places = y[:2] + 0.5 * np.array([[0.0], [-1.0], [1.0]]) * y[2:4]
    quarter = 0.25 * np.add.reduce(places**2, axis=1, keepdims=True)
    directions = (1.0 - quarter) * axes[0] + places @ axes[1:]
    ahead = np.where(directions[:, :1] > 0.0, directions[:, :1], np.nan)
    return np.asarray(directions[:, 1:] / ahead)
