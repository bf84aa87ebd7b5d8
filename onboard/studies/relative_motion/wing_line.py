"""Our own filter as a method of the study: the daemon's `leader.wing_line` and, in a few lines, the life cycle of
`leader.track`. Images must agree before a track is believed. A track that has coasted too far starts anew. A track
that no image agrees with for a second is given up.

The setting takes the place of the daemon's configuration: the size, the leader's class, and the sigma of our own
attitude. The delay of the camera is estimated where the method says so.
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
from onboard.studies.relative_motion.formation import Filter, Images, ImageUpdate, Mask, Method, Setting, Step
from onboard.studies.relative_motion.stacked_states import put, taken
from simlink.scenarios.vehicle import Nav

IMAGES: Final = 3  # that must agree
RELOCK: Final = 1.0  # s
COAST: Final = 0.25  # s
DELAY_SIGMA: Final = 0.15  # s


class Life(NamedTuple):
    """Of B flights: the filter's modes; how many images agree, if not yet enough; the last direction (B, 3) in n
    and span in an image; since when images are gated (inf: they are not); and when an image was last fused."""

    modes: Modes
    agreeing: Array
    direction: Array
    span: Array
    gated_since: Array
    fused_at: Array


def _filter(setting: Setting, delay: float) -> Filter:
    extras = Extras(delay, *_bias(setting.nav), setting.nav.velocity.sigma, middle=True)
    own = _wing_line.Filter(setting.size, setting.size_sigma, MANOEUVRE_MODELS[setting.leader_class], extras)
    return Filter(
        partial(_start, own),
        partial(_predict, own),
        partial(_update, own),
        _nine_states,
        own.m,
        _delay if delay else None,
    )


def _start(own: _wing_line.Filter, images: Images) -> Life:
    y, R_y, sight = _measured(images)
    count = len(y)
    return Life(
        _wing_line.start(own, y, R_y, sight),
        np.ones(count),
        _direction(sight),
        np.hypot(y[:, 2], y[:, 3]),
        np.full(count, np.inf),
        np.full(count, images.t),
    )


def _predict(own: _wing_line.Filter, state: Life, step: Step) -> Life:
    v0 = step.follower.v0
    a = (step.follower.v1 - v0) / step.dt
    return state._replace(modes=_wing_line.advance(own, state.modes, step.dt, v0, a))


def _update(own: _wing_line.Filter, state: Life, images: Images) -> ImageUpdate:
    y, R_y, sight = _measured(images)
    update = _wing_line.fuse(own, state.modes, y, R_y, sight)
    direction, span = _direction(sight), np.hypot(y[:, 2], y[:, 3])
    begun = state.agreeing >= IMAGES
    alike = np.sum(direction * state.direction, axis=1) > np.cos(AGREE_RAD)
    alike &= (span < AGREE_RATIO * state.span) & (state.span < AGREE_RATIO * span)
    wide = begun & (images.t - state.fused_at > COAST)
    if wide.any():
        wide[wide] = _is_wide(taken(state.modes, np.flatnonzero(wide)))
    fused = ~wide & np.where(begun, update.nis <= own.gate, alike)
    gated_since = np.where(fused, np.inf, np.minimum(state.gated_since, images.t))
    given_up = begun & ~wide & (images.t - gated_since > RELOCK)
    anew = wide | given_up | (~begun & ~alike)
    modes = _chosen(fused, update.belief, state.modes)
    if anew.any():
        before = _modes.mixture(taken(state.modes, anew))
        for i, b in enumerate(np.flatnonzero(anew)):
            rows = np.array([b])
            known = Belief(before.mean[[i]], before.covariance[[i]]) if wide[b] else None
            modes = put(modes, rows, _wing_line.start(own, y[rows], R_y[rows], taken(sight, rows), known))
    agreeing = np.where(given_up | (~begun & ~alike), 1.0, np.minimum(state.agreeing + 1, IMAGES))
    after = Life(
        modes,
        agreeing,
        direction,
        span,
        np.where(anew, np.inf, gated_since),
        np.where(fused | anew, images.t, state.fused_at),
    )
    return ImageUpdate(after, np.where(wide, np.nan, update.nis), fused & begun)


def _nine_states(state: Life) -> Belief:
    mean, covariance = _modes.mixture(state.modes)
    unknown = state.agreeing < IMAGES
    mean, covariance = mean[:, :N].copy(), covariance[:, :N, :N].copy()
    mean[unknown], covariance[unknown] = np.nan, np.nan
    return Belief(mean, covariance)


def _delay(state: Life) -> tuple[Array, Array]:
    at = leader_flight.BASE
    mean, covariance = _modes.mixture(state.modes)
    return mean[:, at], np.sqrt(covariance[:, at, at])


def _bias(nav: Nav) -> tuple[tuple[float, float, float], float]:
    """Sigma of our own attitude's error about each axis, rad, and its correlation time, s."""
    sigma = float(np.radians(nav.attitude_deg.sigma))
    return (sigma, sigma, sigma), nav.attitude_deg.time


def _measured(images: Images) -> tuple[Array, Array, ImageGeometry]:
    y, R_y, axes = wing_line.from_points(
        images.points, np.full(images.points.shape[:2], images.sigma), wing_line.M_MIDDLE
    )
    return y, R_y, ImageGeometry(images.R_cn, images.r_FC_n, images.v_F_n, images.omega_b @ images.R_bc, axes)


def _direction(sight: ImageGeometry) -> Array:
    """Directions (B, 3) in n of the center points."""
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
    "wing-line", "the daemon's default, with the center point on the wing", partial(_filter, delay=0.0)
)
WING_LINE_DELAY: Final = Method(
    "wing-line, delay", "the same, with the camera's delay estimated", partial(_filter, delay=DELAY_SIGMA)
)
