"""Our own filter as a method of `formation`: the daemon's `leader.wing_line` and, in a few lines, the life cycle
that `leader.track` gives it: images must agree before a track is believed, one that has coasted too far is begun
anew, and one that agrees with nothing for a second is given up.

In place of a daemon's configuration it is told what the setting tells: the size, the kind of leader, and how wrong
our own attitude may be. The delay of the camera is estimated where the method says so.
"""

from functools import partial
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import modes as _modes
from onboard.estimators.leader import wing_line as _wing_line
from onboard.estimators.leader.image import AGREE_RAD, AGREE_RATIO
from onboard.estimators.leader.modes import Modes
from onboard.estimators.leader.settings import MANOEUVRE_MODELS
from onboard.estimators.leader.track import TOO_WIDE
from onboard.estimators.leader.wing_line_noise import Extras
from onboard.filters.belief import Belief
from onboard.models import leader_flight, wing_line
from onboard.models.leader_flight import ImageGeometry
from onboard.models.relative_motion import N, R
from onboard.studies.relative_motion.formation import Filter, Mask, Method, Seen, Setting, Step, View
from onboard.studies.relative_motion.rows import put, taken
from simlink.scenarios.scene import Nav

IMAGES: Final = 3  # that must agree
RELOCK: Final = 1.0  # s
COAST: Final = 0.25  # s
DELAY_SIGMA: Final = 0.15  # s


class Flown(NamedTuple):
    """Of B flights: the filter's modes; how many images agree, if not yet enough; the last direction (B, 3) in n
    and span seen; since when images are gated (inf: they are not), and when one was last fused."""

    modes: Modes
    agreeing: Array
    look: Array
    span: Array
    gated_since: Array
    fused_at: Array
    now: Array


def _filter(setting: Setting, delay: float) -> Filter:
    extras = Extras(delay, *_bias(setting.nav), setting.nav.velocity.sigma, middle=True)
    own = _wing_line.Filter(setting.size, setting.size_sigma, MANOEUVRE_MODELS[setting.leader_class], extras)

    def start(view: View) -> Flown:
        y, R_y, sight = _measured(view)
        count = len(y)
        return Flown(
            _wing_line.start(own, y, R_y, sight),
            np.ones(count),
            _look(sight),
            np.hypot(y[:, 2], y[:, 3]),
            np.full(count, np.inf),
            np.full(count, view.t),
            np.full(count, view.t),
        )

    def predict(state: Flown, step: Step) -> Flown:
        v0 = step.follower.v0
        a = (step.follower.v1 - v0) / step.dt
        now = np.full_like(state.now, step.t)
        return state._replace(modes=_wing_line.advance(own, state.modes, step.dt, v0, a), now=now)

    def see(state: Flown, view: View) -> Seen:
        y, R_y, sight = _measured(view)
        update = _wing_line.fuse(own, state.modes, y, R_y, sight)
        look, span = _look(sight), np.hypot(y[:, 2], y[:, 3])
        begun = state.agreeing >= IMAGES
        alike = np.sum(look * state.look, axis=1) > np.cos(AGREE_RAD)
        alike &= (span < AGREE_RATIO * state.span) & (state.span < AGREE_RATIO * span)
        wide = begun & (view.t - state.fused_at > COAST)
        if wide.any():
            wide[wide] = _is_wide(taken(state.modes, np.flatnonzero(wide)))
        fused = ~wide & np.where(begun, update.nis <= own.gate, alike)
        gated_since = np.where(fused, np.inf, np.minimum(state.gated_since, view.t))
        given_up = begun & ~wide & (view.t - gated_since > RELOCK)
        anew = wide | given_up | (~begun & ~alike)
        modes = _chosen(fused, update.belief, state.modes)
        if anew.any():
            before = _modes.mixture(taken(state.modes, anew))
            for i, b in enumerate(np.flatnonzero(anew)):
                rows = np.array([b])
                known = Belief(before.mean[[i]], before.covariance[[i]]) if wide[b] else None
                modes = put(modes, rows, _wing_line.start(own, y[rows], R_y[rows], taken(sight, rows), known))
        agreeing = np.where(given_up | (~begun & ~alike), 1.0, np.minimum(state.agreeing + 1, IMAGES))
        after = Flown(
            modes,
            agreeing,
            look,
            span,
            np.where(anew, np.inf, gated_since),
            np.where(fused | anew, view.t, state.fused_at),
            state.now,
        )
        return Seen(after, np.where(wide, np.nan, update.nis), fused & begun)

    def to_nine(state: Flown) -> Belief:
        mean, covariance = _modes.mixture(state.modes)
        unknown = state.agreeing < IMAGES
        mean, covariance = mean[:, :N].copy(), covariance[:, :N, :N].copy()
        mean[unknown], covariance[unknown] = np.nan, np.nan
        return Belief(mean, covariance)

    def lateness(state: Flown) -> tuple[Array, Array]:
        at = leader_flight.BASE
        mean, covariance = _modes.mixture(state.modes)
        return mean[:, at], np.sqrt(covariance[:, at, at])

    return Filter(start, predict, see, to_nine, own.m, lateness if delay else None)


def _bias(nav: Nav) -> tuple[tuple[float, float, float], float]:
    """How wrong our own attitude may be about each axis, rad, and the time in which that changes, s."""
    sigma = float(np.radians(nav.attitude_deg.sigma))
    return (sigma, sigma, sigma), nav.attitude_deg.time


def _measured(view: View) -> tuple[Array, Array, ImageGeometry]:
    y, R_y, axes = wing_line.from_points(
        view.points, np.full(view.points.shape[:2], view.sigma), wing_line.M_MIDDLE
    )
    return y, R_y, ImageGeometry(view.R_cn, view.r_FC_n, view.v_F_n, view.omega_b @ view.R_bc, axes)


def _look(sight: ImageGeometry) -> Array:
    """Directions (B, 3) in n of what was seen."""
    return np.asarray(np.einsum("bi,bij->bj", sight.axes[:, 0], sight.R_cn))


def _is_wide(modes: Modes) -> Mask:
    mean, covariance = _modes.mixture(modes)
    widest = np.linalg.eigvalsh(covariance[:, R, R])[:, -1]
    return np.asarray(widest > (TOO_WIDE * np.linalg.norm(mean[:, R], axis=1)) ** 2)


def _chosen(fused: Mask, after: Modes, before: Modes) -> Modes:
    """The states after an image where it was fused, before it elsewhere."""

    def where(a: Array, b: Array) -> Array:
        return np.asarray(np.where(fused.reshape(-1, *[1] * (a.ndim - 1)), a, b))

    return Modes(*(where(a, b) for a, b in zip(after, before, strict=True)))


WING_LINE: Final = Method(
    "wing-line", "the daemon's default, told that the center is on the wing", partial(_filter, delay=0.0)
)
WING_LINE_DELAY: Final = Method(
    "wing-line, delay", "the same, with the camera's delay estimated", partial(_filter, delay=DELAY_SIGMA)
)
