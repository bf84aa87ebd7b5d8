"""Where the leader may be when its nose may point anywhere: particles over its nose, with a Gaussian each.

One image leaves the nose open, and with it the range. Each particle supposes a nose, and whether the leader
turns it or changes its speed; given those, the rest is nearly linear (`models.apparent_wing`). A new cloud has
noses over half a circle: a wing looks the same from the front and from behind. A particle loses weight only by
evidence.

Smoothness is no evidence. A near leader that flies calmly and a far one that flies twice as boldly look alike, and
how boldly a leader flies is not known. So all noise is proportional to the range that a particle's nose
implies, and no nose fits smooth motion better than another. Evidence is our own known motion, and a line of
sight that turns while the nose does not.

Random numbers are a fixed function of the count of steps, so the same images give the same cloud.
"""

import math
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.filter import Measurement
from onboard.estimators.leader.filters.noses.changes import APART, DRAWS, MOST_CRAB, change
from onboard.estimators.leader.filters.noses.cloud import ARRAYS, Cloud
from onboard.estimators.leader.filters.noses.draws import normal, uniform
from onboard.estimators.leader.filters.noses.evidence import (
    ANY_NOSE,
    OF_SHAPE,
    expected,
    fitted,
    of_points,
    of_poses,
    posed,
)
from onboard.estimators.leader.settings import NoseModel
from onboard.estimators.leader.size import Size
from onboard.estimators.leader.wind import Wind
from onboard.models import apparent_shape
from onboard.models import apparent_wing as model
from onboard.models.apparent_wing import BANK_ERROR, LEAN, STRETCH, A, N, R, V

EXPECTING: Final = 0.3  # of the weight: at least so many particles must have expected an image
SURE: Final = 10.0  # times as long until a particle takes another nose, where points show the nose
LEAST_RANGE: Final = (
    0.05  # of the largest range at which a first image may be: points in a row may hide each other
)
FORGETS: Final = 5  # of so many particles one has a new nose when a track starts again
MOST_EVIDENCE: Final = 40.0  # of the logarithm of a likelihood ratio, by one image
MOVING: Final = 3.0  # m/s: if we fly faster, a leader that flies along with us is likely
NOSE_BIN: Final = math.radians(6.0)  # rad
RANGE_BIN: Final = 0.05  # of the range's logarithm
LEAST_WEIGHT: Final = 0.002  # of a bin that counts
PER_BIN: Final = 6  # particles
CHANGE: Final = 1.5  # the number of particles changes by this factor at least
HORIZONTAL: Final = np.array([1.0, 1.0, 0.5])  # vertical accelerations are half as large
SLIP: Final = math.radians(3.0)  # rad, of a fixed wing's nose about its path through the air
DIAGONAL: Final = np.arange(N)


def start(settings: NoseModel, seen: Measurement, pose: CameraPose, before: Cloud | None = None) -> Cloud:
    """The cloud after one image. Of what was known `before` of the same leader only the noses are kept, of all but
    each FORGETS-th particle; where it is and how it moves may have changed while it was not seen."""
    direction = seen.axes[0] @ pose.R_cn
    noses, prior = _first_noses(settings, math.atan2(direction[1], direction[0]), pose.v_F_n)
    if before is not None:
        kept = np.arange(len(noses)) % FORGETS > 0
        known = _resampled(before, settings.particles).noses
        noses, prior = np.where(kept, known, noses), np.full(len(noses), 1.0 / len(noses))
    k = len(noses)
    edge_on, lasting = model.LEAST_VISIBLE, 0.0
    shows = None if seen.has_wing else seen.shows
    if seen.is_metric and seen.pose is not None:
        edge_on, lasting = ANY_NOSE, seen.pose.lasting
    elif shows is not None:
        edge_on, lasting = shows.edge_on, shows.lasting
    # about the range, as a share of the largest possible
    broad = model.visible(noses, np.tile(direction, (k, 1)), edge_on)
    range_ = settings.size * broad / seen.span
    if seen.is_metric:
        range_ = np.full(k, settings.size / seen.span)
    elif shows is not None:
        range_ = settings.size * apparent_shape.spread(shows.extent, noses, seen.axes @ pose.R_cn) / seen.span
        range_ = np.maximum(range_, LEAST_RANGE * range_.max())
    means, P = np.zeros((k, N)), np.zeros((k, N, N))
    means[:, R], means[:, V] = range_[:, None] * direction + pose.r_FC_n, pose.v_F_n
    line = np.outer(direction, direction)
    along = (max(seen.span_sigma / seen.span, 0.01) * range_) ** 2
    across = seen.R[0, 0] * range_**2
    P[:, R, R] = along[:, None, None] * line + across[:, None, None] * (np.eye(3) - line)
    hovers = uniform(APART, k) < (settings.hovering if settings.crab == 0.0 else 0.0)
    intensities = np.column_stack([s * normal(APART + 1 + 2 * i, k) for i, s in enumerate(settings.intensity)])
    factors = np.exp(intensities)
    speed = (broad[:, None] * settings.speed * np.array([1.0, 1.0, 0.4])) ** 2
    diagonal = np.zeros((k, N))
    diagonal[:, V], diagonal[:, A] = speed, (broad[:, None] * settings.acceleration * HORIZONTAL) ** 2
    diagonal[hovers, V] = settings.hover_speed**2 + settings.own_velocity**2
    diagonal[hovers, A] = settings.hover_acceleration**2
    means[hovers, V] = 0.0
    diagonal[:, BANK_ERROR] = (broad * factors[:, 1] * settings.bank) ** 2
    shortens = np.maximum(1.0 - broad**2, 0.0) / broad**2
    diagonal[:, STRETCH] = settings.stretch**2 + (factors[:, 2] * settings.nose_wobble) ** 2 * shortens
    P[:, DIAGONAL, DIAGONAL] += diagonal
    _lean(settings, means, P, pose.v_F_n)
    means[hovers, LEAN] = 0.0
    turns = uniform(0, k) < settings.turning
    rates = np.where(turns, settings.nose_rate * normal(1, k), 0.0)
    regimes = np.where(
        hovers, model.HOVERING, np.where(uniform(3, k) < settings.accelerating, model.ACCELERATING, model.STEADY)
    )
    return Cloud(
        noses,
        rates,
        regimes.astype(float),
        means,
        P,
        intensities,
        np.log(prior),
        4,
        edge_on,
        lasting,
        metric=seen.is_metric,
    )


def _lean(settings: NoseModel, means: Array, P: Array, v_F_n: Array) -> None:
    """What is known of a lean against the air: drag times an airspeed, with an unknown wind."""
    level = v_F_n[:2]
    means[:, LEAN] = settings.drag * level
    speeds = P[:, 3:5, 3:5]
    known = settings.drag_sigma**2 * (np.outer(level, level) + speeds) + (
        settings.drag * settings.wind
    ) ** 2 * np.eye(2)
    P[:, LEAN, LEAN] = settings.drag**2 * speeds + known + 1e-8 * np.eye(2)
    P[:, LEAN, 3:5] = P[:, 3:5, LEAN] = settings.drag * speeds


def _first_noses(settings: NoseModel, bearing: float, v_F_n: Array) -> tuple[Any, Any]:
    """Noses (K,) and their prior probabilities: all noses alike, and those along our own course more likely if we
    fly; for a fixed wing only noses about our course."""
    k = settings.particles
    moving = math.hypot(v_F_n[0], v_F_n[1]) > MOVING
    course = math.atan2(v_F_n[1], v_F_n[0])
    if moving and settings.crab > 0:
        apart = MOST_CRAB * (2.0 * (np.arange(k) + 0.5) / k - 1.0)
        return course + apart * settings.crab, np.full(k, 1.0 / k)  # `with_course` says which are likely
    few = k // 4 if moving else 0
    noses = bearing + math.pi * (np.arange(k - few) + 0.5) / (k - few)
    prior = np.full(k - few, 1.0 / (k - few))
    if few:
        apart = 2.5 * (2.0 * (np.arange(few) + 0.5) / few - 1.0)
        likely = np.exp(-0.5 * apart**2)
        noses = np.append(noses, course + apart * settings.heading)
        prior = np.append(prior * (1.0 - settings.on_course), likely * settings.on_course / likely.sum())
    return noses, prior


def predict(settings: NoseModel, cloud: Cloud, dt: float, moved: Array) -> Cloud:
    """The cloud after `dt` seconds in which we move by `moved` (3,) m, in n."""
    s = settings
    changed = [array.copy() for array in cloud[:ARRAYS]]
    sure = SURE if cloud.sided else 1.0
    doubted_after = sure * s.doubted_after
    change(
        s, changed, cloud.draws, dt, moved, doubted_after=doubted_after, edge_on=cloud.edge_on, metric=cloud.metric
    )
    noses, rates, regimes, means, P, intensities = changed
    times = np.array([s.acceleration_time, s.bank_time, s.stretch_time])
    noise, decay = _noise(s, dt), np.exp(-dt / times)
    model.predict(
        means, P, noses, dt, moved, regimes, intensities, noise, _hover(s, dt), decay, s.drag, cloud.edge_on
    )
    arrays = noses, rates, regimes, means, P, intensities
    return Cloud(*arrays, cloud.log_weights, cloud.draws + DRAWS, *cloud[8:])


def _hover(s: NoseModel, dt: float) -> model.Hover:
    velocity, acceleration = math.exp(-dt / s.hover_time), math.exp(-dt / s.hover_acceleration_time)
    return model.Hover(
        velocity,
        acceleration,
        s.hover_speed**2 * (1.0 - velocity**2),
        s.hover_acceleration**2 * (1.0 - acceleration**2),
    )


def _noise(s: NoseModel, dt: float) -> model.Noise:
    """What `dt` seconds add, in proportion to the range that a nose implies (`models.apparent_wing.Noise`)."""
    fixed, broad, range_ = np.zeros(N), np.zeros((3, N)), np.zeros(N)
    range_[R] = 2.0 * dt / s.misalignment_time * np.square(s.misalignment)[[2, 2, 0]]
    fixed[R], fixed[V], fixed[LEAN] = 1e-8, 2.0 * dt / s.own_velocity_time * s.own_velocity**2, 1e-10
    new = -math.expm1(-2.0 * dt / s.stretch_time)
    fixed[STRETCH] = s.stretch**2 * new
    broad[:2, V], broad[:, LEAN] = s.velocity_random_walk**2 * dt, s.lean_random_walk**2 * dt
    broad[:2, A] = np.outer(np.square(s.acceleration_random_walk), HORIZONTAL**2) * dt
    broad[:, BANK_ERROR] = s.bank**2 * -math.expm1(-2.0 * dt / s.bank_time)
    return model.Noise(fixed, broad, range_, 2.0 * dt * s.drag_sigma**2, s.nose_wobble**2 * new)


def supposed(settings: NoseModel, size: Size | None, wind: Wind | None) -> NoseModel:
    """What is assumed, with the size and the wind as they are known now."""
    if size is not None:
        settings = settings._replace(size=size.value, size_sigma=size.sigma)
    if wind is not None:
        north, east, _ = wind.velocity.tolist()
        settings = settings._replace(air=(north, east), air_sigma=wind.sigma, nose_about_course=SLIP)
    return settings


def predicted(settings: NoseModel, cloud: Cloud, seen: Measurement, pose: CameraPose) -> tuple[Array, Array]:
    """What the whole cloud expects of an image: mean (m,) and covariance (m, m), without the image's own noise."""
    w, camera = np.exp(cloud.log_weights), (pose.R_cn, pose.r_FC_n, seen.axes)
    return model.prediction(cloud.means, cloud.covariances, cloud.noses, w, settings.size, seen.y, camera)


def update(settings: NoseModel, cloud: Cloud, seen: Measurement, pose: CameraPose) -> tuple[Cloud, float]:
    """The cloud after an image, and the NIS that EXPECTING of its weight have at most. If that exceeds the
    gate, too few expected the image, and the cloud is returned as it was. What an image shows beyond center and
    wing has a gate of its own. Raises FilterError."""
    shows, given = seen.shows, cloud
    if seen.is_metric and seen.pose is not None:
        cloud = of_poses(settings, cloud, seen.pose.lasting)
    elif cloud.lasting > 0.0 and (seen.has_wing or (shows is not None and not shows.is_box)):
        cloud = of_points(settings, cloud)
    after, log_l, least = cloud._replace(misfits=()), np.zeros(len(cloud.noses)), 0.0
    if shows is None or not shows.is_box:
        means, P = cloud.means.copy(), cloud.covariances.copy()
        arguments = seen.y, seen.R, pose.R_cn, pose.r_FC_n, seen.axes
        nis, log_l = model.update(means, P, cloud.noses, settings.size, *map(np.ascontiguousarray, arguments))
        least = expected(cloud, nis, EXPECTING)
        if least > settings.gate:
            return given, least
        after = cloud._replace(means=means, covariances=P)
    if shows is not None:
        fit = fitted(settings, after, shows, seen.axes, pose)
        if fit.cloud is not None:
            after, log_l = fit.cloud._replace(sided=cloud.sided or shows.rows.named), log_l + fit.log_l
            after = after._replace(misplaced=max(cloud.misplaced, shows.misplaced))
        elif shows.is_box:
            return given, fit.beyond
        after = after._replace(misfits=fit.misfits)
    if seen.pose is not None:
        found, pose_nis, more = posed(settings, after, seen.pose, pose)
        beyond = expected(cloud, pose_nis, OF_SHAPE)
        if beyond <= settings.gate:
            after, log_l = found, log_l + more
        elif seen.is_metric:
            return given, beyond
    log_weights = cloud.log_weights + settings.temper * np.maximum(log_l, log_l.max() - MOST_EVIDENCE)
    log_weights -= log_weights.max()
    log_weights -= math.log(np.exp(log_weights).sum())
    after = after._replace(log_weights=log_weights)
    w, count = np.exp(log_weights), enough(settings, after)
    is_apt = len(w) / CHANGE < count < len(w) * CHANGE
    if 1.0 / np.sum(w * w) > settings.resample * len(w) and is_apt:
        return after, least
    return _resampled(after, count), least


def enough(settings: NoseModel, cloud: Cloud) -> int:
    """How many particles there should be: in proportion to the number of different noses and ranges that have
    weight, as in KLD-sampling (Fox, 2003)."""
    r = cloud.means[:, R]
    nose = np.floor(np.mod(cloud.noses, math.tau if cloud.sided else math.pi) / NOSE_BIN)
    range_ = np.floor(0.5 * np.log(np.einsum("ki,ki->k", r, r)) / RANGE_BIN)
    _, at = np.unique(nose + 1000.0 * range_, return_inverse=True)
    occupied = np.count_nonzero(np.bincount(at, np.exp(cloud.log_weights)) > LEAST_WEIGHT)
    return min(max(PER_BIN * int(occupied), settings.fewest), settings.particles)


def _resampled(cloud: Cloud, k: int) -> Cloud:
    """k particles, drawn by their weights, which become alike: systematic resampling."""
    at = (np.arange(k) + uniform(cloud.draws, 1)[0]) / k
    chosen = np.minimum(np.searchsorted(np.cumsum(np.exp(cloud.log_weights)), at), len(cloud.noses) - 1)
    noses, rates, regimes, means, P, intensities = (array[chosen] for array in cloud[:ARRAYS])
    log_weights = np.full(k, -math.log(k))
    return Cloud(noses, rates, regimes, means, P, intensities, log_weights, cloud.draws + 1, *cloud[8:])


def rescaled(cloud: Cloud, ratio: float, v_F_n: Array) -> Cloud:
    """The cloud of a leader that is `ratio` times as large: as much farther away, and as much faster relative to
    us, who fly with v_F_n (3,) m/s."""
    scale = np.where(DIAGONAL < BANK_ERROR, ratio, 1.0)
    means = cloud.means * scale
    means[:, V] += (1.0 - ratio) * v_F_n
    return cloud._replace(means=means, covariances=cloud.covariances * scale[:, None] * scale)
