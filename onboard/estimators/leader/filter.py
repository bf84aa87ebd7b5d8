"""The leader's filters, one target at a time, behind one face: what a track needs of a filter.

`wing-line` is what we fly by default (`_wing_line`). `paper` and `subtended` are Oh & Johnson's nine states and
three angles, with their noise settings as printed and with honest ones (`oh_johnson_noise`).
"""

from typing import Any, Final, NamedTuple, Protocol

from onboard.arrays import Array
from onboard.filters.belief import Belief, Update
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
