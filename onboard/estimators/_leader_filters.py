"""The leader's filters, one target at a time, behind one face: what a track needs of a filter.

`wing-line` is what we fly by default (`_wing_line`). `paper` and `subtended` are Oh & Johnson's nine states and
three angles, with their noise settings as printed and with honest ones (`_leader_noise`).
"""

import math
from typing import Any, Final, NamedTuple, Protocol

from onboard.estimators import _wing_line, _wing_line_noise
from onboard.estimators._wing_line import Filter as WingLine
from onboard.estimators._wing_line_noise import Extras
from onboard.filters.belief import Belief, Update
from onboard.geometry.rotations import Array
from onboard.models import leader_modes, wing_line
from onboard.models.leader_flight import Sight
from onboard.models.leader_modes import Modes
from onboard.ownship import Step

WING: Final = slice(2, 4)  # of the measurement: from wingtip to wingtip


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
    from onboard.estimators import _leader_noise, _oh_johnson  # noqa: PLC0415 - machine code that few flights need

    settings = "paper" if name == "paper" else "honest"
    noise = _leader_noise.overridden(_leader_noise.noise_for(settings, leader_class), overrides)
    # the paper takes its own attitude as known, so its settings stay as printed
    return _oh_johnson.OhJohnson(noise, size, size_sigma, attitude_sigma * (name != "paper"))


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
