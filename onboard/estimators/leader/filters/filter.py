"""What a track needs of a filter of one target: a protocol, and the measurement that all filters share."""

import math
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.noses.places import Place
from onboard.estimators.leader.posed import Posed
from onboard.estimators.leader.shape import Seen, Shape
from onboard.estimators.leader.size import Size
from onboard.estimators.leader.wind import Wind
from onboard.filters.belief import Belief, Update
from onboard.models import wing_line
from onboard.ownship import Step

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


class LeaderFilter(Protocol):
    """A filter of one target. Its states are opaque to the track; FilterErrors pass through."""

    components: tuple[str, ...]
    units: tuple[str, ...]
    measured_components: tuple[str, ...]
    measured_units: tuple[str, ...]
    gate: float | None  # NIS above which an image is not fused; None: all are
    shape: Shape | None  # of what it follows; None: the filter uses nothing but center and wing

    def measure(self, points: Array, sigmas: Array) -> Measurement:
        """The measurement of image points (3, 2), center, left and right, with standard deviations (3,), all in
        focal lengths."""

    def start(self, measurement: Measurement, pose: CameraPose, before: Any) -> Any:
        """The state after a first image; `before` is the state of an earlier track, or None."""

    def informed(self, state: Any, prior: Belief) -> Any:
        """The first state with what was believed before: position relative to us and velocity, (6,) and (6, 6), in
        n. None if they contradict each other."""

    def advance(self, state: Any, step: Step) -> Any:
        """The state after a step of our own motion."""

    def fuse(self, state: Any, measurement: Measurement, pose: CameraPose) -> Update:
        """The update by an image; its belief is a state."""

    def resized(self, state: Any, size: Size) -> Any:
        """The state once the size is known better from elsewhere."""

    def in_wind(self, state: Any, wind: Wind) -> Any:
        """The state in another wind, or in one that is not known any more."""

    def belief(self, state: Any) -> Belief:
        """Mean (n,) and covariance (n, n), the first nine components those of `relative_motion`."""

    def predicted_points(self, state: Any, measurement: Measurement, update: Update, pose: CameraPose) -> Array:
        """Image points (3, 2) that `state` predicts, in focal lengths; NaN for a point behind the camera."""

    def open_question(self, state: Any) -> Open:
        """What the images leave open."""

    def is_too_wide(self, state: Any, share: float) -> bool:
        """Whether the position is less certain than this share of the range: an image cannot correct it."""
