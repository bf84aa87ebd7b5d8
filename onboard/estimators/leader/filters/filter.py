"""What a track needs of a filter of one target: a protocol, and the measurement that all filters share."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.filters.noses.places import Place
from onboard.estimators.leader.posed import Posed
from onboard.estimators.leader.shape import Seen
from onboard.models import wing_line

WING: Final = slice(2, 4)  # of the measurement: from wingtip to wingtip


class Measurement(NamedTuple):
    """What an image measures: y (m,) and its noise R (m, m); the wing's span and its standard deviation, rad;
    `axes` (3, 3), unit vectors in c: the direction of the center, and the two that the wing is measured along;
    and what it shows beyond center and wing. Where the wing was not seen (`has_wing`), the span is the spread of
    that, and its sigma infinite if nothing shows the range. With a pose alone it is that of the wing broadside,
    and the range does not depend on the size (`is_metric`)."""

    y: Array
    R: Array
    span: float
    span_sigma: float
    axes: Array
    shows: Seen | None = None
    has_wing: bool = True
    pose: Posed | None = None
    is_metric: bool = False

    def with_attitude_noise(self, noise_c: Array) -> "Measurement":
        """The measurement by a camera whose attitude has white noise, a small rotation in c of covariance noise_c
        (3, 3): all directions move together, and the wing turns about them."""
        if not noise_c.any():
            return self
        by = np.zeros((len(self.y), 3))  # by how much a rotation changes y
        by[0], by[1] = self.axes[2], -self.axes[1]
        if len(self.y) > 3:
            by[2], by[3] = -self.y[3] * self.axes[0], self.y[2] * self.axes[0]
        by[4:] = by[: max(len(self.y) - 4, 0)]  # the wing's middle as the center
        return self._replace(R=self.R + by @ noise_c @ by.T)

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


class Open(NamedTuple):
    """What the images leave open, for a person, "" if nothing; the places where the leader may be, as the belief's
    first six components, if the range is open; and whether the range is that of poses, and says nothing of the
    size."""

    reason: str = ""
    places: tuple[Place, ...] = ()
    is_metric: bool = False
