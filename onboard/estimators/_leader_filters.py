"""The leader's filters, one target at a time, behind one face: what a track needs of a filter.

`wing-line` is what we fly by default (`_wing_line`). `paper` and `subtended` are Oh & Johnson's nine states and
three angles, with their noise settings as printed and with honest ones (`_leader_noise`).
"""

import math
from functools import partial
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from onboard.estimators import _leader_noise, _wing_line, _wing_line_noise
from onboard.estimators._leader_noise import Noise
from onboard.estimators._wing_line import Filter as WingLine
from onboard.estimators._wing_line_noise import Extras
from onboard.filters import unscented
from onboard.filters.belief import Belief, Update
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.rotations import Array
from onboard.models import camera_angles, leader_modes, relative_motion, wing_line
from onboard.models.leader_flight import Sight
from onboard.models.leader_modes import Modes
from onboard.models.relative_motion import FollowerMotion
from onboard.ownship import Step

WING: Final = slice(2, 4)  # of the measurement: from wingtip to wingtip
WEIGHTS: Final = unscented.julier_weights(relative_motion.N)


class View(NamedTuple):
    """The camera at the time of an image: R_cn (3, 3), r_FC_n (3,), F's velocity and the camera's rates (3,)."""

    R_cn: Array
    r_FC_n: Array
    v_F_n: Array
    omega_c: Array


class Seen(NamedTuple):
    """What an image measures: y (m,) and its noise R (m, m); the span of the wing, rad, and its standard
    deviation; the direction of the center in c (3,), which is the first of `axes` (3, 3), the others being those
    that the wing is measured in."""

    y: Array
    R: Array
    span: float
    span_sigma: float
    look_c: Array
    axes: Array


class LeaderFilter(Protocol):
    """What a track needs of a filter of one target. States are opaque; FilterErrors pass through."""

    components: tuple[str, ...]
    units: tuple[str, ...]
    seen_components: tuple[str, ...]
    seen_units: tuple[str, ...]
    gate: float | None
    images: int | None  # that must agree before a track starts; None: as configured

    def see(self, points: Array, sigmas: Array) -> Seen:
        """What image points (3, 2) with standard deviations (3,) measure."""

    def start(self, seen: Seen, view: View, before: Any) -> Any:
        """The state after a first image; `before` is the state of an earlier track, or None."""

    def advance(self, state: Any, step: Step) -> Any:
        """The state after a step of our own motion."""

    def fuse(self, state: Any, seen: Seen, view: View) -> Update:
        """The update by an image; its belief is a state."""

    def believed(self, state: Any) -> Belief:
        """Mean (n,) and covariance (n, n), the first nine those of `relative_motion`."""

    def expected(self, state: Any, seen: Seen, update: Update, view: View) -> Array:
        """Image points (3, 2) that were expected; NaN for what is behind the camera."""


def make(
    name: str,
    *,
    size: float,
    size_sigma: float,
    leader_class: str,
    overrides: dict[str, float],
    attitude_sigma: Array,
    extras: Extras,
) -> LeaderFilter:
    """The filter of that name. `attitude_sigma` (3,) rad is how far our own attitude may be off, which the
    wing-line filter estimates instead (`extras`).

    Raises ValueError for overrides that the filter does not have.
    """
    if name == "wing-line":
        manner = _wing_line_noise.overridden(_wing_line_noise.MANNERS[leader_class], overrides)
        return _WingLine(WingLine(size, size_sigma, manner, extras))
    settings = "paper" if name == "paper" else "honest"
    noise = _leader_noise.overridden(_leader_noise.noise_for(settings, leader_class), overrides)
    # the paper takes its own attitude as known, so its settings stay as printed
    return _OhJohnson(noise, size, size_sigma, attitude_sigma * (name != "paper"))


class _WingLine:
    """`_wing_line`, for one target."""

    def __init__(self, filter_: WingLine) -> None:
        self.components, self.units = filter_.components, filter_.units
        self.seen_components: tuple[str, ...] = wing_line.COMPONENTS[: filter_.m]
        self.seen_units: tuple[str, ...] = wing_line.UNITS[: filter_.m]
        self.gate: float | None = filter_.gate
        self.images: int | None = None
        self._filter = filter_

    def see(self, points: Array, sigmas: Array) -> Seen:
        y, R, axes = wing_line.from_points(points[None], sigmas[None], self._filter.m)
        (a, b), ((aa, ab), (_, bb)) = y[0, WING].tolist(), R[0, WING, WING].tolist()
        span = math.hypot(a, b)
        along = max(a * a * aa + 2 * a * b * ab + b * b * bb, 0.0)
        return Seen(y[0], R[0], span, math.sqrt(along) / span if span > 0 else math.sqrt(aa), axes[0, 0], axes[0])

    def start(self, seen: Seen, view: View, before: Any) -> Modes:
        known = None if before is None else _wing_line.believed(before)
        return _wing_line.start(self._filter, seen.y[None], seen.R[None], _sight(seen, view), known)

    def advance(self, state: Modes, step: Step) -> Modes:
        return _wing_line.advance(self._filter, state, step.dt, step.v0[None], step.a[None])

    def fuse(self, state: Modes, seen: Seen, view: View) -> Update:
        u = _wing_line.fuse(self._filter, state, seen.y[None], seen.R[None], _sight(seen, view))
        return Update(u.belief, u.innovation[0], u.innovation_covariance[0], u.predicted[0], float(u.nis[0]))

    def believed(self, state: Modes) -> Belief:
        mean, covariance = _wing_line.believed(state)
        return Belief(mean[0], covariance[0])

    def expected(self, state: Modes, seen: Seen, update: Update, view: View) -> Array:
        del update
        points: Array = leader_modes.expected_points(state, _sight(seen, view), self._filter.manner.hover_speed)[0]
        return points


def _sight(seen: Seen, view: View) -> Sight:
    return Sight(view.R_cn[None], view.r_FC_n[None], view.v_F_n[None], view.omega_c[None], seen.axes[None])


class _OhJohnson:
    """The paper's filter; `attitude_sigma` is added to what is reported: an error of our own attitude is nearly
    constant, so the images cannot average it out and their innovations do not show it."""

    def __init__(self, noise: Noise, size: float, size_sigma: float, attitude_sigma: Array) -> None:
        self.components: tuple[str, ...] = relative_motion.COMPONENTS
        self.units: tuple[str, ...] = relative_motion.UNITS
        self.seen_components: tuple[str, ...] = camera_angles.COMPONENTS
        self.seen_units: tuple[str, ...] = camera_angles.UNITS
        probability = noise.gate_probability
        self.gate: float | None = (
            None if probability is None else chi_square_threshold(probability, camera_angles.M)
        )
        self.images: int | None = noise.initialise_images
        self._noise, self._size, self._size_sigma = noise, size, size_sigma
        self._attitude_sigma = attitude_sigma
        self._Q = _leader_noise.process_noise(noise, size)
        self._considered = (relative_motion.SIZE,) if noise.consider_size else ()

    def see(self, points: Array, sigmas: Array) -> Seen:
        angles = camera_angles.angles_from_points(points)
        R = camera_angles.noise_from_points(points, sigmas)
        sigma = float(np.sqrt(R[2, 2]))
        if self._noise.angles_deg is not None:
            R = np.diag(np.radians(self._noise.angles_deg) ** 2)
        look, wing = np.array([1.0, *points[0]]), points[2] - points[1]
        length = np.hypot(*wing)
        axes = np.zeros((3, 3))
        axes[0], axes[1, 1:] = look / np.linalg.norm(look), wing / length if length else wing
        return Seen(angles, R, float(angles[2]), sigma, axes[0], axes)

    def start(self, seen: Seen, view: View, before: Any) -> Belief:
        del before  # the paper begins anew
        return _leader_noise.initial_belief(
            self._noise, seen.y, seen.R, self._size, self._size_sigma, view.R_cn, view.r_FC_n
        )

    def advance(self, state: Belief, step: Step) -> Belief:
        motion = FollowerMotion(step.v0, step.v1, step.a, step.a)
        process = partial(relative_motion.process, dt=step.dt, follower=motion, eps=self._noise.hover_speed)
        return unscented.predict(state, process, np.diag(self._Q * step.dt), WEIGHTS)

    def fuse(self, state: Belief, seen: Seen, view: View) -> Update:
        measure = partial(camera_angles.measure, R_cn=view.R_cn, r_FC_n=view.r_FC_n)
        return unscented.update(state, seen.y, measure, seen.R, WEIGHTS, camera_angles.ANGULAR, self._considered)

    def believed(self, state: Belief) -> Belief:
        own = relative_motion.rotation_covariance(state.mean, self._attitude_sigma)
        return Belief(state.mean, state.covariance + own)

    def expected(self, state: Belief, seen: Seen, update: Update, view: View) -> Array:
        """The center from the predicted angles, the wingtips at the predicted span along the wing as seen: this
        filter does not predict the leader's bank."""
        del state, view
        center = np.tan(update.predicted[:2])
        half = np.tan(0.5 * update.predicted[2]) * np.sqrt(1.0 + center @ center)
        return np.array([center, center - half * seen.axes[1, 1:], center + half * seen.axes[1, 1:]])
