"""Which filter a leader's track has, by the configuration.

`wing-line` is what we fly by default. `paper` and `subtended` are Oh & Johnson's nine states and three
angles, with their noise settings as printed and with honest ones (`oh_johnson_noise`).
"""

import math
from typing import Any, Final

from onboard.arrays import Array
from onboard.estimators.leader import modes as leader_modes
from onboard.estimators.leader import wing_line as lines
from onboard.estimators.leader import wing_line_noise
from onboard.estimators.leader.filter import LeaderFilter, Seen, View
from onboard.estimators.leader.modes import Modes
from onboard.estimators.leader.wing_line_noise import Extras
from onboard.filters.belief import Belief, Update
from onboard.models import wing_line
from onboard.models.leader_flight import Sight
from onboard.ownship import Step

WING: Final = slice(2, 4)  # of the measurement: from wingtip to wingtip


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
        manner = wing_line_noise.overridden(wing_line_noise.MANNERS[leader_class], overrides)
        return _WingLine(lines.Filter(size, size_sigma, manner, extras))
    from onboard.estimators.leader import oh_johnson, oh_johnson_noise  # noqa: PLC0415 - machine code that few flights need

    settings = "paper" if name == "paper" else "honest"
    noise = oh_johnson_noise.overridden(oh_johnson_noise.noise_for(settings, leader_class), overrides)
    # the paper takes its own attitude as known, so its settings stay as printed
    return oh_johnson.OhJohnson(noise, size, size_sigma, attitude_sigma * (name != "paper"))


class _WingLine:
    """`_wing_line`, for one target."""

    def __init__(self, filter_: lines.Filter) -> None:
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
        known = None if before is None else lines.believed(before)
        return lines.start(self._filter, seen.y[None], seen.R[None], _sight(seen, view), known)

    def advance(self, state: Modes, step: Step) -> Modes:
        return lines.advance(self._filter, state, step.dt, step.v0[None], step.a[None])

    def fuse(self, state: Modes, seen: Seen, view: View) -> Update:
        u = lines.fuse(self._filter, state, seen.y[None], seen.R[None], _sight(seen, view))
        return Update(u.belief, u.innovation[0], u.innovation_covariance[0], u.predicted[0], float(u.nis[0]))

    def believed(self, state: Modes) -> Belief:
        mean, covariance = lines.believed(state)
        return Belief(mean[0], covariance[0])

    def expected(self, state: Modes, seen: Seen, update: Update, view: View) -> Array:
        del update
        points: Array = leader_modes.expected_points(state, _sight(seen, view), self._filter.manner.hover_speed)[0]
        return points


def _sight(seen: Seen, view: View) -> Sight:
    return Sight(view.R_cn[None], view.r_FC_n[None], view.v_F_n[None], view.omega_c[None], seen.axes[None])
