"""Mean and covariance of a whole cloud of noses, and what they come to a moment later."""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.filters.noses import moments
from onboard.estimators.leader.filters.noses.cloud import Cloud
from onboard.estimators.leader.filters.noses.moments import (
    A_L,
    LOG_SIZE,
    NOSE,
    OWN_VELOCITY,
    R_FL,
    V_L,
    N,
)
from onboard.estimators.leader.filters.noses.places import Place, places
from onboard.estimators.leader.settings import NoseModel
from onboard.filters.belief import Belief
from onboard.models import apparent_wing as model

RESOLVED: Final = 0.15  # of the range: a cloud that is less certain leaves it open, and confirms nothing
MOTION: Final = slice(0, 6)  # position and velocity

STAYS: Final = np.eye(N)
MOVES: Final = np.zeros((N, N))
MOVES[R_FL, V_L] = MOVES[V_L, A_L] = np.eye(3)
MOVES[R_FL, OWN_VELOCITY] = -np.eye(3)
CURVES: Final = np.zeros((N, N))
CURVES[R_FL, A_L] = np.eye(3)


class Summary(NamedTuple):
    """Mean (15,) and covariance (15, 15) of [r_FL_n, v_L, a_L, own velocity's error, log of the size, nose, bank's
    error], vectors in n. Where the range is open, also the places where the leader may be."""

    mean: Array
    covariance: Array
    places: tuple[Place, ...] = ()

    def after(self, dt: float, moved: Array) -> "Summary":
        """`dt` seconds later, at constant acceleration; we have moved by `moved` (3,) m, in n."""
        if dt <= 0.0:
            return self
        F = STAYS + dt * MOVES + 0.5 * dt * dt * CURVES
        mean = F @ self.mean
        mean[R_FL] -= moved
        return Summary(mean, F @ self.covariance @ F.T, tuple(p.after(dt, moved) for p in self.places))

    def range_sigma(self) -> float:
        """The standard deviation of the range, as a share of it."""
        x, y, z = self.mean[R_FL].tolist()  # three numbers: Python's arithmetic is fast
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.covariance[R_FL, R_FL].tolist()
        along = x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz)
        return math.sqrt(max(along, 0.0)) / float(x * x + y * y + z * z)

    def direction_sigma(self) -> float:
        """The standard deviation of the direction where it is least certain, rad."""
        r = self.mean[R_FL]
        across = np.eye(3) - np.outer(r, r) / float(r @ r)
        largest = float(np.linalg.eigvalsh(across @ self.covariance[R_FL, R_FL] @ across)[-1])
        return math.sqrt(max(largest, 0.0)) / float(np.linalg.norm(r))


def summarise(settings: NoseModel, cloud: Cloud) -> Summary:
    """The cloud as one Gaussian about its geometric mean range, with the errors that are ours: of our attitude
    and our velocity."""
    w = with_course(settings, cloud)
    about, period = _middle(cloud.noses, w) if cloud.sided else (cloud.noses[int(np.argmax(w))], math.pi)
    mean, covariance = np.zeros(N), np.zeros((N, N))
    within = (w @ cloud.covariances.reshape(len(w), -1)).reshape(cloud.covariances.shape[1:])
    log_range = moments.moments(cloud.noses, cloud.means, w, about, period, within, mean, covariance)
    log_range += _resolved(mean, covariance) * (_median(cloud.means[:, R_FL], w) - log_range)
    mean, covariance = _about(mean, covariance, math.exp(log_range))
    r, by_points = mean[R_FL], _by_points(cloud, mean)
    covariance[R_FL, R_FL] += by_points * (r[:, None] * r)
    covariance[MOTION, MOTION] += _by_pose(settings, mean[R_FL])
    covariance[NOSE, NOSE] += settings.misalignment[2] ** 2

    def ours(r_FL_n: Array) -> Array:
        by_pose = _by_pose(settings, r_FL_n)
        by_pose[:3, :3] += by_points * np.outer(r_FL_n, r_FL_n)
        return by_pose

    whole = Summary(mean, 0.5 * (covariance + covariance.T))
    if whole.range_sigma() <= RESOLVED:
        return whole
    return whole._replace(places=places(w, cloud.means[:, MOTION], cloud.covariances[:, MOTION, MOTION], ours))


def _resolved(mean: Array, covariance: Array) -> float:
    """How far the range is resolved, from 0 to 1: then its median is published. From behind, the many noses that
    are not quite on the course all mean a nearer leader, and drag a mean to that side. An open range has far
    modes, and of these a mean is about as likely to be twice too far as twice too near."""
    r = mean[R_FL]
    sigma = math.sqrt(max(float(r @ covariance[R_FL, R_FL] @ r), 0.0)) / float(r @ r)
    return min(max(2.0 - sigma / RESOLVED, 0.0), 1.0)


def _median(r: Array, w: Array) -> float:
    """The median of the logarithms of the ranges of places r (K, 3) with weights w (K,)."""
    log_range = 0.5 * np.log(np.einsum("ki,ki->k", r, r))
    order = log_range.argsort()
    sorted_w = w[order]
    below = sorted_w.cumsum() - 0.5 * sorted_w
    return float(np.interp(0.5, below, log_range[order]))


def with_course(settings: NoseModel, cloud: Cloud) -> Array:
    """Weights (K,) of the particles, with what is likely of the nose of a fixed wing and its course. Of others,
    the particles themselves suppose that (`cloud.Cloud.tied`).

    That is prior knowledge about an angle that lasts. It is applied to what is reported and not to the cloud
    itself, where each image would count it again."""
    w = np.exp(cloud.log_weights)
    if settings.crab == 0.0:
        return np.asarray(w)
    x, P = cloud.means, cloud.covariances
    u, v = x[:, 3] - settings.air[0], x[:, 4] - settings.air[1]
    speed2 = u * u + v * v + 1e-6
    aside = cloud.noses - np.arctan2(v, u)
    aside -= math.pi * np.round(aside / math.pi)
    a, b = v / speed2, -u / speed2
    S = a * a * P[:, 3, 3] + 2.0 * a * b * P[:, 3, 4] + b * b * P[:, 4, 4] + settings.nose_about_course**2
    S += settings.air_sigma**2 / speed2
    share = speed2**2 / (speed2**2 + model.FOLLOWS4)
    likely = np.exp(-0.5 * aside**2 / S) / np.sqrt(2.0 * math.pi * S)
    w *= (1.0 - share) / math.pi + share * likely
    return np.asarray(w / w.sum())


def _by_points(cloud: Cloud, mean: Array) -> float:
    """The variance of the range's logarithm by the bias of named points. They make a nose wrong,
    and with it the range: the more, the less is seen of the wing."""
    if not cloud.misplaced:
        return 0.0
    direction = mean[None, R_FL] / np.linalg.norm(mean[R_FL])
    seen = float(model.visible(mean[NOSE : NOSE + 1], direction, 0.0)[0])
    return (cloud.misplaced * (1.0 - seen**2)) ** 2


def _by_pose(settings: NoseModel, r_FL_n: Array) -> Array:
    """The covariance (6, 6) of position and velocity that errors of our attitude and velocity cause."""
    x, y, z = r_FL_n.tolist()
    turned = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    P = np.zeros((6, 6))
    P[:3, :3] = turned.T @ (_variances(settings.misalignment) * turned)
    P[3, 3] = P[4, 4] = P[5, 5] = settings.own_velocity**2
    return P


@lru_cache(maxsize=64)
def _variances(sigmas: tuple[float, float, float]) -> Array:
    """As a column (3, 1)."""
    return np.array([[sigma * sigma] for sigma in sigmas])


def _about(mean: Array, covariance: Array, range_: float) -> tuple[Array, Array]:
    """The mean moved to another range, m, and what goes with it, and the second moments about it there.

    An open range has a long tail to the far side, which drags a mean with it. The geometric mean is about as
    likely to be twice too far as twice too near."""
    r = mean[R_FL]
    distance = math.sqrt(r @ r)
    along = covariance[:, R_FL] @ (r / distance)
    variance = float(along[R_FL] @ r) / distance
    step = (range_ - distance) / variance * along
    step[LOG_SIZE] = 0.0  # whatever moves the range, it is not the size
    return mean + step, covariance + step[:, None] * step


def _middle(noses: Array, w: Array) -> tuple[float, float]:
    """The middle of noses (K,) with weights (K,) that are distinguished from tails, and after what angle they
    repeat, both in rad."""
    return math.atan2(float(w @ np.sin(noses)), float(w @ np.cos(noses))), 2.0 * math.pi


def as_leader(known: Summary, dt: float, moved: Array, v_F_n: Array) -> Belief:
    """The belief `dt` seconds after a summary, in which we move by `moved` (3,) m, in n, with the components of
    `models.leader_flight`."""
    return Belief(*moments.as_leader(known.mean, known.covariance, dt, moved, v_F_n))
