"""What a cloud of noses becomes by what an image shows beyond center and wing: a shape, or a pose.

Points and boxes show the range of a leader of the configured size; a pose alone shows the range itself. Each of
them has an error that lasts, which no number of images reduces. It is no part of the particles, but of the
summary; where another kind of image follows, it becomes uncertainty of each particle's range.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.noses.cloud import Cloud
from onboard.estimators.leader.posed import LASTING_TURN, Posed
from onboard.estimators.leader.settings import NoseModel
from onboard.estimators.leader.shape import Seen, only
from onboard.filters.belief import Belief, FilterError
from onboard.models import apparent_pose, apparent_shape
from onboard.models.apparent_wing import FREE, LEAST_VISIBLE, R

MOTION: Final = slice(0, 6)  # position and velocity
OF_SHAPE: Final = 0.02  # of the weight: so much must have expected a shape; only the right noses do
PER_ROW: Final = 2.1  # more of the gate for each row of what an image shows of a shape
LASTING: Final = 4.0  # noise that lasts counts as often
ANY_NOSE: Final = 1.0  # as `edge_on`: of a leader whose range is measured, noise depends little on its nose


class Fit(NamedTuple):
    """The cloud after what an image shows of a shape, None if that fits no nose, with the particles' logarithms of
    likelihoods (K,), the NIS that OF_SHAPE of the weight have at most, and the named points that fit none."""

    cloud: Cloud | None
    log_l: Array
    beyond: float
    misfits: tuple[str, ...] = ()


def fitted(settings: NoseModel, cloud: Cloud, shows: Seen, axes: Array, pose: CameraPose) -> Fit:
    """The cloud after what an image shows of the leader's shape. If all of it fits no nose, the points that fit
    none by themselves are left out: one point that a detector finds elsewhere costs the others nothing. Raises
    FilterError."""

    def fit(part: Seen) -> Fit:
        found, nis, log_l = shaped(settings, cloud, part, axes, pose)
        beyond = expected(cloud, nis, OF_SHAPE)
        fits = beyond <= settings.gate + PER_ROW * len(part.rows.y)
        return Fit(found if fits else None, log_l, beyond)

    whole = fit(shows)
    if whole.cloud is not None or shows.is_box:
        return whole
    every = range(len(shows.names))
    fitting = [k for k in every if fit(only(shows, [k])).cloud is not None]
    misfits = tuple(shows.names[k] for k in every if k not in fitting)
    rest = fit(only(shows, fitting)) if misfits and fitting else whole
    return rest._replace(misfits=misfits)


def expected(cloud: Cloud, nis: Array, share: float) -> float:
    """The NIS that a share of the weight has at most. Raises FilterError."""
    order = np.argsort(nis)
    least = float(nis[order][np.searchsorted(np.cumsum(np.exp(cloud.log_weights[order])), share)])
    if not math.isfinite(least):
        raise FilterError("the cloud of noses has lost its numbers")
    return least


def informed(settings: NoseModel, cloud: Cloud, prior: Belief) -> Cloud | None:
    """The cloud with what was believed of position and velocity before, (6,) and (6, 6), in n; None where less
    than OF_SHAPE of its weight agrees: only the right noses do. Raises FilterError."""
    C = cloud.covariances[:, :, MOTION]
    S, y = C[:, MOTION] + prior.covariance, prior.mean - cloud.means[:, MOTION]
    gain = np.linalg.solve(S, C.transpose(0, 2, 1)).transpose(0, 2, 1)
    nis = np.einsum("ki,ki->k", y, np.linalg.solve(S, y[:, :, None])[:, :, 0])
    if expected(cloud, nis, OF_SHAPE) > settings.gate:
        return None
    means = cloud.means + np.einsum("kij,kj->ki", gain, y)
    P = cloud.covariances - gain @ C.transpose(0, 2, 1)
    log_weights = cloud.log_weights - 0.5 * (nis + np.linalg.slogdet(S)[1])
    log_weights -= log_weights.max()
    log_weights -= math.log(np.exp(log_weights).sum())
    return cloud._replace(means=means, covariances=0.5 * (P + P.transpose(0, 2, 1)), log_weights=log_weights)


def shaped(
    settings: NoseModel, cloud: Cloud, shows: Seen, axes: Array, pose: CameraPose
) -> tuple[Cloud, Array, Array]:
    """The cloud after what an image shows of the leader's shape, with each particle's NIS and log likelihood. In a
    cloud that points have made sharp, a box counts as far as what lasts of its error allows."""
    noses, means, P = cloud.noses.copy(), cloud.means.copy(), cloud.covariances.copy()
    rows, camera = shows.rows, (pose.R_cn, pose.r_FC_n, axes)
    if shows.is_box and (cloud.lasting == 0.0 or cloud.metric):
        doubt = LASTING * math.hypot(shows.lasting, _by_size(settings, cloud)) * float(np.ptp(rows.y))
        rows = rows._replace(sigma=np.hypot(rows.sigma, doubt))
    nis, log_l = apparent_shape.update(means, P, noses, settings.size, rows, shows.posture, camera)
    return cloud._replace(noses=noses, means=means, covariances=P, tied=_still(cloud, noses)), nis, log_l


def posed(settings: NoseModel, cloud: Cloud, shows: Posed, camera: CameraPose) -> tuple[Cloud, Array, Array]:
    """The cloud after a pose, with each particle's NIS and log likelihood. In a cloud whose ranges are those of a
    leader of the configured size, a range counts as far as its lasting error, and the size's, allow."""
    noses, means, P = cloud.noses.copy(), cloud.means.copy(), cloud.covariances.copy()
    nis, log_l, nose = np.zeros(len(noses)), np.zeros(len(noses)), shows.nose(camera)
    if shows.range_ is not None:
        of_size = settings.size_sigma / settings.size
        doubt = 0.0 if cloud.metric else LASTING * math.hypot(shows.lasting, of_size)
        sigma = math.hypot(shows.range_sigma, doubt * shows.range_)
        nis, log_l = apparent_pose.measure_range(means, P, camera.r_FC_n, shows.range_, sigma)
    if nose is not None:
        log_l = log_l + apparent_pose.measure_nose(noses, means, P, *nose)
        cloud = cloud._replace(sided=True, misplaced=max(cloud.misplaced, LASTING_TURN))
    return cloud._replace(noses=noses, means=means, covariances=P, tied=_still(cloud, noses)), nis, log_l


def _still(cloud: Cloud, noses: Array) -> Array:
    """Which noses (K,) are still tied to their courses: not those that were measured elsewhere."""
    return np.where(noses == cloud.noses, cloud.tied, np.minimum(cloud.tied, FREE))


def of_points(settings: NoseModel, cloud: Cloud) -> Cloud:
    """The cloud before the first image that shows points: how far boxes or poses mislead, and after poses the
    size, becomes uncertainty of each range, and points reduce it."""
    wider = _wider(cloud, math.hypot(cloud.lasting, _by_size(settings, cloud)))
    return wider._replace(edge_on=LEAST_VISIBLE, lasting=0.0, metric=False)


def of_poses(settings: NoseModel, cloud: Cloud, lasting: float) -> Cloud:
    """The cloud before the first image with a pose alone: the ranges were those of a leader of the configured
    size."""
    if cloud.metric:
        return cloud
    wider = _wider(cloud, math.hypot(cloud.lasting, settings.size_sigma / settings.size))
    return wider._replace(edge_on=ANY_NOSE, lasting=lasting, metric=True)


def _by_size(settings: NoseModel, cloud: Cloud) -> float:
    """By how much, as a share, the ranges of this cloud and of one of the configured size may differ."""
    return settings.size_sigma / settings.size if cloud.metric else 0.0


def _wider(cloud: Cloud, share: float) -> Cloud:
    """The cloud with each range less certain by this share of it."""
    r, P = cloud.means[:, R], cloud.covariances.copy()
    P[:, R, R] += share**2 * r[:, :, None] * r[:, None, :]
    return cloud._replace(covariances=P)
