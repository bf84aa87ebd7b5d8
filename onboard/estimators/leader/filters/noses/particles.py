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
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.filters.auxiliary import Auxiliary
from onboard.estimators.leader.filters.noses import leaning, moments
from onboard.estimators.leader.filters.noses.changes import DRAWS, change
from onboard.estimators.leader.filters.noses.cloud import ARRAYS, Bias, Cloud, named
from onboard.estimators.leader.filters.noses.draws import uniform
from onboard.estimators.leader.filters.noses.evidence import (
    ANY_NOSE,
    OF_SHAPE,
    charged,
    corrected,
    expected,
    fitted,
    posed,
    weighted,
)
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement
from onboard.estimators.leader.settings import NoseModel
from onboard.estimators.leader.wind import Wind
from onboard.filters.gating import chi_square_threshold
from onboard.models import apparent_wing as model
from onboard.models.apparent_wing import (
    ACCELERATION,
    BANK_ERROR,
    LEAN,
    LEAST_VISIBLE,
    POSITION,
    STRETCH,
    VELOCITY,
    N,
)

EXPECTING: Final = 0.3  # of the weight: at least so many particles must have expected an image
SURE: Final = 10.0  # times as long until a particle takes another nose, where points show the nose
TRUE: Final = 0.9999  # the probability that a report or a range passes that is true
APART_S: Final = 0.2  # of the evidence of one of these, in seconds
MOST_COST: Final = 20.0  # of what a hypothesis supposes: it is improbable enough then
FRESH_S: Final = 8.0  # over which the evidence of a new track is used
TOGETHER_S: Final = 0.05  # what is measured at one time, by different means, counts as if it came so soon after
NOSE_BIN: Final = math.radians(6.0)  # rad
RANGE_BIN: Final = 0.05  # of the range's logarithm
LEAST_WEIGHT: Final = 0.002  # of a bin that counts
PER_BIN: Final = 6  # particles
CHANGE: Final = 1.5  # the number of particles changes by this factor at least
HORIZONTAL: Final = np.array([1.0, 1.0, 0.5])  # vertical accelerations are half as large
SLIP: Final = math.radians(3.0)  # rad, of a fixed wing's nose about its path through the air


def predict(settings: NoseModel, cloud: Cloud, dt: float, moved: Array) -> Cloud:
    """The cloud after `dt` seconds in which we move by `moved` (3,) m, in n."""
    s = settings
    changed: list[Any] = [array.copy() for array in cloud[: ARRAYS - 1]]  # type: ignore[union-attr]
    sure = SURE if cloud.sided else 1.0
    doubted_after = sure * s.doubted_after
    change(
        s,
        changed,
        cloud.draws,
        dt,
        moved,
        doubted_after=doubted_after,
        edge_on=cloud.edge_on,
        metric=cloud.metric,
    )
    noses, _, regimes, means, P, intensities, tied, drags = changed
    lasts = [bias.time for bias in cloud.biases]
    times = np.array([s.acceleration_time, s.bank_time, s.stretch_time, *lasts])
    noise, decay = _noise(s, dt, cloud.biases), np.exp(-dt / times)
    after = cloud._replace(**named(changed), draws=cloud.draws + DRAWS, unseen=cloud.unseen + dt)
    before = _supposed(s, after)
    model.predict(
        *(means, P, noses, dt, moved, regimes, intensities, noise, _hover(s, dt), decay, drags),
        model.Course(tied, s.air, cloud.edge_on),
    )
    return charged(after, _supposed(s, after) - before)


def _supposed(s: NoseModel, cloud: Cloud) -> Array:
    """Logarithms of the likelihoods (K,) of the leans, and of the banks that have lasted. Whatever an image makes
    of them counts in full: a hypothesis may suppose any, and not get one for nothing where few images count. One
    that takes another nose has paid: it is accepted by the same likelihood."""
    if s.drag == 0.0 or cloud.edge_on > LEAST_VISIBLE:
        return np.zeros(len(cloud.noses))
    arrays = cloud.noses, cloud.means, cloud.covariances, cloud.drags, cloud.rolled
    found: Array = leaning.plausible(*arrays, s.wind, s.rolled, MOST_COST)
    return found


def _hover(s: NoseModel, dt: float) -> model.Hover:
    velocity, acceleration = math.exp(-dt / s.hover_time), math.exp(-dt / s.hover_acceleration_time)
    return model.Hover(
        velocity,
        acceleration,
        s.hover_speed**2 * (1.0 - velocity**2),
        s.hover_acceleration**2 * (1.0 - acceleration**2),
    )


def _noise(s: NoseModel, dt: float, biases: tuple[Bias, ...]) -> model.Noise:
    """What `dt` seconds add, in proportion to the range that a nose implies (`models.apparent_wing.Noise`)."""
    per_second = _densities(s)
    new, of_bank = -math.expm1(-2.0 * dt / s.stretch_time), s.bank**2 * -math.expm1(-2.0 * dt / s.bank_time)
    fixed = np.zeros(N + len(biases))
    fixed[N:] = [bias.sigma**2 * -math.expm1(-2.0 * dt / bias.time) for bias in biases]
    fixed[POSITION], fixed[VELOCITY], fixed[LEAN] = 1e-8, 2.0 * dt / s.own_velocity_time * s.own_velocity**2, 1e-10
    fixed[STRETCH] = s.stretch**2 * new
    broad = per_second.broad * dt
    broad[:, BANK_ERROR] = of_bank
    range_ = 2.0 * dt / s.misalignment_time * per_second.range_
    return model.Noise(fixed, broad, range_, s.nose_wobble**2 * new, math.log(s.size))


class Densities(NamedTuple):
    """Of the noise of a step (`models.apparent_wing.Noise`), what grows with its duration: `broad`, each second,
    and `range_`, over half of the time of the misalignment."""

    broad: Array
    range_: Array


@lru_cache(maxsize=64)
def _densities(s: NoseModel) -> Densities:
    broad, range_ = np.zeros((3, N)), np.zeros(N)
    range_[POSITION] = np.square(s.misalignment)[[2, 2, 0]]
    broad[:2, VELOCITY], broad[:, LEAN] = s.velocity_random_walk**2, s.lean_random_walk**2
    broad[:2, ACCELERATION] = np.outer(np.square(s.acceleration_random_walk), HORIZONTAL**2)
    return Densities(broad, range_)


def supposed(settings: NoseModel, wind: Wind | None) -> NoseModel:
    """What is assumed, with the wind as it is known now."""
    if wind is not None:
        north, east, _ = wind.velocity.tolist()
        settings = settings._replace(air=(north, east), air_sigma=wind.sigma, nose_about_course=SLIP)
    return settings


def predicted(
    settings: NoseModel, cloud: Cloud, seen: Measurement, pose: CameraPose
) -> tuple[Array, Array, model.Expectation]:
    """What the whole cloud expects of an image: mean (m,) and covariance (m, m), without the image's own noise;
    and what each particle expects."""
    w, camera = np.exp(cloud.log_weights), (pose.R_cn, pose.r_FC_n, seen.axes)
    arrays = cloud.means, cloud.covariances, cloud.noses
    return model.prediction(*arrays, w, seen.y, camera, model.Course(cloud.tied, settings.air))


def update(
    settings: NoseModel, cloud: Cloud, seen: Measurement, pose: CameraPose, each: model.Expectation | None = None
) -> tuple[Cloud, float]:
    """The cloud after an image, and the NIS that EXPECTING of its weight have at most. If that exceeds the
    gate, too few expected the image, and the cloud is returned as it was. What an image shows beyond center and
    wing has a gate of its own. `each`: what the particles expected of the image, where that is known. Raises
    FilterError."""
    shows, given = seen.shows, cloud
    if seen.is_metric and seen.pose is not None:
        cloud = _seen_by(cloud, ANY_NOSE, metric=True)
    elif seen.has_wing or (shows is not None and not shows.is_box):
        cloud = _seen_by(cloud, LEAST_VISIBLE, metric=False)
    if shows is None or not shows.is_box:
        if each is None:
            _, _, each = predicted(settings, cloud, seen, pose)
        noses, means, P = cloud.noses.copy(), cloud.means.copy(), cloud.covariances.copy()
        nis, log_l = model.update(means, P, noses, seen.y, seen.R, each, model.Course(cloud.tied, settings.air))
        least = expected(cloud, nis, EXPECTING)
        if least > settings.gate:
            return given, least
        after = cloud._replace(noses=noses, means=means, covariances=P, misfits=())
    else:
        after, log_l, least = cloud._replace(misfits=()), np.zeros(len(cloud.noses)), 0.0
    if shows is not None:
        fit = fitted(settings, after, shows, seen.axes, pose)
        if fit.cloud is not None:
            after, log_l = fit.cloud._replace(sided=cloud.sided or shows.rows.named), log_l + fit.log_l
            after = after._replace(misplaced=max(cloud.misplaced, shows.misplaced))
        elif shows.is_box:
            return given, fit.beyond
        after = after._replace(misfits=fit.misfits)
    if seen.pose is not None:
        found, pose_nis, more = posed(after, seen.pose, pose)
        beyond = expected(cloud, pose_nis, OF_SHAPE)
        if beyond <= settings.gate:
            after, log_l = found, log_l + more
        elif seen.is_metric:
            return given, beyond
    believed, fresh = _counted(settings, cloud, pose)
    new = -math.expm1(-cloud.unseen / settings.rolled_time)
    rolled = after.rolled + new * (after.means[:, BANK_ERROR] - after.rolled)
    after = after._replace(rolled=rolled, unseen=0.0, fresh=fresh)
    costs = _supposed(settings, after) - _supposed(settings, cloud)
    return fitting(settings, charged(weighted(after, log_l, believed), costs)), least


def _seen_by(cloud: Cloud, edge_on: float, *, metric: bool) -> Cloud:
    """The cloud of which images show so much along its wing, and its range by poses or not."""
    is_same = cloud.edge_on == edge_on and cloud.metric is metric
    return cloud if is_same else cloud._replace(edge_on=edge_on, metric=metric)


def _counted(settings: NoseModel, cloud: Cloud, pose: CameraPose) -> tuple[float, float]:
    """As what share of an independent image one counts, and what is left of the evidence of a new track. The
    faster the view of the leader changes, the more does an image count; while the view stays the same, so do the
    errors of what each particle supposes."""
    r = cloud.means[:, POSITION]
    moves = (cloud.means[:, VELOCITY] - pose.v_F_n) / np.sqrt(np.add.reduce(r * r, axis=1, keepdims=True))
    moving = np.exp(cloud.log_weights) @ moves
    change = math.sqrt(moving @ moving)  # 1/s
    rate = settings.steady_evidence + change / settings.new_view + cloud.fresh / FRESH_S
    seconds = max(cloud.unseen, TOGETHER_S)
    left = cloud.fresh * math.exp(-seconds / FRESH_S)
    return min(min(rate, settings.evidence_rate) * seconds, 1.0), left


def assist(settings: NoseModel, cloud: Cloud, taken: Auxiliary, *, is_open: bool) -> Cloud | None:
    """The cloud after what is measured beside the images; None where too few particles expected it: of a cloud
    whose range `is_open`, the right ones are few. Raises FilterError."""
    known = cloud.with_biases(*taken.biases)
    rows = taken.rows(known)
    found, nis, log_l = corrected(known, *rows)
    limit = chi_square_threshold(TRUE, rows.innovations.shape[1])
    if expected(known, nis, OF_SHAPE if is_open else EXPECTING) > limit:
        return None
    return fitting(settings, weighted(found, log_l, min(settings.evidence_rate * APART_S, 1.0)))


def fitting(settings: NoseModel, cloud: Cloud) -> Cloud:
    """The cloud with as many particles as there should be, drawn anew where few have the weight."""
    w, count = np.exp(cloud.log_weights), enough(settings, cloud)
    is_apt = len(w) / CHANGE < count < len(w) * CHANGE
    if 1.0 / float(np.add.reduce(w * w)) > settings.resample * len(w) and is_apt:
        return cloud
    return resampled(cloud, count)


def enough(settings: NoseModel, cloud: Cloud) -> int:
    """How many particles there should be: in proportion to the number of different noses and ranges that have
    weight, as in KLD-sampling (Fox, 2003). Where points show the nose, the right noses are few degrees wide: what
    follows a nose that turns must be dense there."""
    r = cloud.means[:, POSITION]
    log_range = 0.5 * np.log(np.einsum("ki,ki->k", r, r))
    turn = math.tau if cloud.sided else math.pi
    bins = NOSE_BIN, RANGE_BIN, LEAST_WEIGHT
    occupied = int(moments.occupied(cloud.noses, log_range, np.exp(cloud.log_weights), turn, *bins))
    fewest = settings.fewest_sided if cloud.sided else settings.fewest
    return min(max(PER_BIN * occupied, fewest), settings.particles)


def resampled(cloud: Cloud, k: int) -> Cloud:
    """k particles, drawn by their weights, which become alike: systematic resampling."""
    at = (np.arange(k) + uniform(cloud.draws, 1)[0]) / k
    chosen = np.minimum(np.searchsorted(np.cumsum(np.exp(cloud.log_weights)), at), len(cloud.noses) - 1)
    arrays = (array[chosen] for array in cloud[:ARRAYS])
    log_weights = np.full(k, -math.log(k))
    return cloud._replace(**named(arrays), log_weights=log_weights, draws=cloud.draws + 1)
