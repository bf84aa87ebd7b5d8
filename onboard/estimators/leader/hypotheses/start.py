"""The particles after a first image.

Headings over half a circle, those along our own course likelier if we fly."""

import math
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses import tilt, view
from onboard.estimators.leader.hypotheses.draws import (
    OF_FIRST_DRAG,
    OF_FIRST_HOVERING,
    OF_FIRST_INTENSITIES,
    OF_FIRST_SIZE,
    OF_REGIME,
    OF_TURN_RATE,
    OF_TURNING,
    normal,
    uniform,
)
from onboard.estimators.leader.hypotheses.motion import (
    ACCELERATION,
    BANK_ERROR,
    LOG_SIZE,
    POSITION,
    TILT,
    VELOCITY,
    VX,
    VZ,
    WING_SCALE_ERROR,
    N,
)
from onboard.estimators.leader.hypotheses.particles import Bias, Particles, evidence, resampled, weighted
from onboard.estimators.leader.hypotheses.prediction import HORIZONTAL
from onboard.estimators.leader.hypotheses.update import ANY_HEADING, BOXES, of_ranges
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement

LEVEL: Final = slice(VX, VZ)


def start(
    settings: LeaderModel, seen: Measurement, pose: CameraPose, before: Particles | None = None
) -> Particles:
    """The particles after one image.

    Of what was known `before` of the same leader only the headings are kept, and not all of them; where it is and
    how it moves may have changed while it was not seen."""
    direction = seen.axes[0] @ pose.R_cn
    slope = _wing_slope(seen, pose) if seen.has_wing and settings.drag > 0.0 else None
    headings, prior = _first_headings(settings, direction, pose.v_F_n, slope)
    if before is not None:
        kept = np.arange(len(headings)) % given.RESTART_HEADING_INTERVAL > 0
        known = resampled(before, settings.particles).headings
        headings, prior = np.where(kept, known, headings), np.full(len(headings), 1.0 / len(headings))
    k = len(headings)
    edge_on_visibility = given.MIN_VISIBLE_FRACTION if seen.edge_on_visibility is None else seen.edge_on_visibility
    if seen.is_metric:
        edge_on_visibility = ANY_HEADING
    of_size = settings.size_sigma / settings.size
    within = min(of_size, given.MAX_GAUSSIAN_SIZE_SIGMA)
    sizes = settings.size * np.exp(math.sqrt(of_size**2 - within**2) * normal(OF_FIRST_SIZE, k))
    # about the range, as a share of the largest possible
    visible = model.visible(headings, np.tile(direction, (k, 1)), edge_on_visibility)
    broad = visible * sizes / settings.size
    range_ = sizes * visible / seen.span
    if slope is not None:
        range_ = sizes * tilt.shown(headings, direction, slope) / seen.span
    if seen.is_metric:
        range_ = np.full(k, settings.size / seen.span)
    elif seen.extent is not None:
        range_ = sizes * view.spread(seen.extent.rows, headings, seen.axes @ pose.R_cn) / seen.span
        range_ = np.maximum(range_, given.MIN_FIRST_RANGE_RATIO * range_.max())
    means, P = np.zeros((k, N)), np.zeros((k, N, N))
    means[:, POSITION], means[:, VELOCITY] = range_[:, None] * direction + pose.r_FC_n, pose.v_F_n
    line = np.outer(direction, direction)
    along = (max(seen.span_sigma / seen.span, 0.01) * range_) ** 2
    across = (seen.rows.R[0, 0] + seen.off**2) * range_**2
    P[:, POSITION, POSITION] = along[:, None, None] * line + across[:, None, None] * (np.eye(3) - line)
    hovers = uniform(OF_FIRST_HOVERING, k) < settings.hovering
    drawn = [normal(of_one, k) for of_one in OF_FIRST_INTENSITIES]
    intensities = np.column_stack([s * one for s, one in zip(settings.intensity, drawn, strict=True)])
    means[hovers, VELOCITY] = 0.0
    P[:, range(N), range(N)] += _variances(settings, broad, hovers, np.exp(intensities), visible, slope or 0.0)
    drags = tilt.drags_of(settings, OF_FIRST_DRAG, k)
    _set_tilts(settings, means, P, drags)
    log_l = np.zeros(k)
    if slope is not None:
        log_l = tilt.first(means, P, headings, drags, slope, settings.wind, np.sqrt(P[:, BANK_ERROR, BANK_ERROR]))
    means[:, LOG_SIZE], restless = np.log(sizes), np.exp(intensities[:, 2])
    often = restless**1.5 * settings.turns_for / settings.still_for
    turns = uniform(OF_TURNING, k) < often / (1.0 + often)
    rates = np.where(turns, settings.nose_rate * restless * normal(OF_TURN_RATE, k), 0.0)
    flies = np.where(uniform(OF_REGIME, k) < settings.accelerating, model.ACCELERATING, model.STEADY)
    regimes = np.where(hovers, model.HOVERING, flies).astype(float)
    lock = np.full(k, model.UNDECIDED if settings.tied > 0.0 else model.FREE)
    arrays = headings, rates, regimes, means, P, intensities, lock, drags, np.zeros(k), np.log(prior)
    particles = Particles(
        *arrays,
        draws=4,
        edge_on_visibility=edge_on_visibility,
        metric=seen.is_metric,
        startup_evidence=settings.first_evidence,
        mean_nis=1.0 if before is None else before.mean_nis,
    )
    return _add_scales(weighted(particles, evidence(log_l, 1.0)), seen, range_[:, None] * direction, within)


def _add_scales(particles: Particles, seen: Measurement, r: Array, size_sigma: float) -> Particles:
    """Add the uncertainty of the size and of the image's bias, which scale the places r (K, 3) m."""
    _add_scale_variance(particles, r, LOG_SIZE, size_sigma, 0.0 if seen.is_metric else 1.0)
    if seen.has_wing:
        sigma = np.sqrt(particles.covariances[:, WING_SCALE_ERROR, WING_SCALE_ERROR])
        _add_scale_variance(particles, r, WING_SCALE_ERROR, sigma, 1.0)
    if seen.is_metric and seen.pose is not None:
        bias, share = of_ranges(seen.pose), -1.0
    elif seen.rows.bias is not None:
        bias, share = Bias(BOXES, seen.rows.bias), 1.0
    else:
        return particles
    particles = particles.with_biases(bias)
    _add_scale_variance(particles, r, particles.column(bias.name), bias.sigma, share)
    return particles


def _add_scale_variance(particles: Particles, r: Array, column: int, sigma: float | Array, share: float) -> None:
    """Add the uncertainty of a scale's logarithm, `sigma` or (K,), in place.

    The places r (K, 3) m grow with this share of it."""
    P, variance = particles.covariances, np.broadcast_to(np.square(sigma), len(r))
    P[:, column, column] = variance
    P[:, POSITION, column] = P[:, column, POSITION] = share * variance[:, None] * r
    P[:, POSITION, POSITION] += share**2 * variance[:, None, None] * r[:, :, None] * r[:, None, :]


def _variances(
    settings: LeaderModel, broad: Array, hovers: Any, factors: Array, visible: Array, slope: float
) -> Array:
    """Return the variances of the first states (K, N) without the image.

    They are in proportion to the share of the largest range, `broad` (K,), but for leaders that hover; `factors`
    (K, 3) of the intensities, `visible` (K,) of the wing, and the wing's slope."""
    found = np.zeros((len(broad), N))
    found[:, VELOCITY] = (broad[:, None] * settings.speed * np.array([1.0, 1.0, 0.4])) ** 2
    found[:, ACCELERATION] = (broad[:, None] * settings.acceleration * HORIZONTAL) ** 2
    bold2 = factors[hovers, :1] ** 2
    found[hovers, VELOCITY] = bold2 * settings.hover_speed**2 + settings.own_velocity**2
    found[hovers, ACCELERATION] = bold2 * settings.hover_acceleration**2
    found[:, BANK_ERROR] = (broad * factors[:, 1] * settings.bank) ** 2
    level2 = visible**2 * (1.0 + slope**2) ** 2  # what shows by its bank does not depend on the heading
    shortens2 = np.maximum(1.0 - visible**2, 0.0) / level2
    found[:, WING_SCALE_ERROR] = settings.stretch**2 + (factors[:, 2] * settings.nose_wobble) ** 2 * shortens2
    return found


def _wing_slope(seen: Measurement, pose: CameraPose) -> float:
    """Return the slope of the wing to the horizon.

    That of an upright wing is limited by the noise of its tips."""
    ahead, right, down = seen.axes @ pose.R_cn
    wing = seen.y[2] * right + seen.y[3] * down
    level = math.hypot(ahead[0], ahead[1])
    aside = float(ahead[0] * wing[1] - ahead[1] * wing[0]) / max(level, 1e-9)
    below = float(wing[2]) / max(level, 1e-9)
    return below / math.copysign(max(abs(aside), math.sqrt(float(seen.rows.R[2, 2]))), aside)


def _set_tilts(settings: LeaderModel, means: Array, P: Array, drags: Array) -> None:
    """Set the tilts against the air: the drag times an airspeed, with an unknown wind."""
    of_air = P[:, LEVEL, LEVEL] + settings.wind**2 * np.eye(2)
    means[:, TILT] = drags[:, None] * means[:, LEVEL]
    P[:, TILT, TILT] = (drags**2)[:, None, None] * of_air + 1e-8 * np.eye(2)
    P[:, TILT, LEVEL] = P[:, LEVEL, TILT] = drags[:, None, None] * P[:, LEVEL, LEVEL]


def _first_headings(settings: LeaderModel, direction: Array, v_F_n: Array, slope: float | None) -> tuple[Any, Any]:
    """Headings (K,) and their prior probabilities.

    All headings alike, and those along our own course more likely if we fly. The closer where the wing's `slope`
    is that of a bank which a multirotor may have: of a steep one few headings are left, and many drags and winds
    are possible with each."""
    k = settings.particles
    moving = math.hypot(v_F_n[0], v_F_n[1]) > given.MIN_FORMATION_SPEED
    course = math.atan2(v_F_n[1], v_F_n[0])
    few = k // 4 if moving else 0
    around = math.pi * (np.arange(k - few) + 0.5) / (k - few)
    prior = np.full(k - few, 1.0 / (k - few))
    if slope:  # the tangent of the bank is steep * cos(around + turned): all is turned where we look up or down
        level = max(math.hypot(direction[0], direction[1]), 1e-9)
        steep, turned = math.hypot(slope, direction[2]) / level, math.atan2(direction[2], slope)
        widest = min(given.MAX_FIRST_BANK, math.atan(steep))
        banks = widest * (2.0 * (np.arange(0, k - few, 2) + 0.5) / (k - few) - 1.0)
        around[::2] = (np.arccos(np.tan(banks) / steep) - turned) % math.pi
        across = steep * np.cos(around + turned)
        closer = math.pi * steep * np.abs(np.sin(around + turned)) / (2.0 * widest * (1.0 + across**2))
        prior = 1.0 / (1.0 + np.where(np.abs(across) <= math.tan(widest), closer, 0.0))
        prior /= prior.sum()
    headings = math.atan2(direction[1], direction[0]) + around
    if few:
        apart = 2.5 * (2.0 * (np.arange(few) + 0.5) / few - 1.0)
        likely = np.exp(-0.5 * apart**2)
        headings = np.append(headings, course + apart * settings.heading)
        prior = np.append(prior * (1.0 - settings.on_course), likely * settings.on_course / likely.sum())
    return headings, prior
