"""What a cloud of noses becomes by what an image shows beyond center and wing: a shape, or a pose.

Points and boxes show the range of a leader of some size; a pose alone shows the range itself. Each of them has an
error that lasts, which no number of images reduces: it is a part of each particle's state.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.filters.noses.cloud import Bias, Cloud
from onboard.estimators.leader.hypotheses import points
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.pose import TURN_BIAS, PoseFeatures
from onboard.estimators.leader.image.shape import ShapeFeatures, only
from onboard.estimators.leader.settings import NoseModel
from onboard.filters.belief import Belief, FilterError
from onboard.models import apparent_pose
from onboard.models.apparent_wing import FREE, POSITION

MOTION: Final = slice(0, 6)  # position and velocity
OF_SHAPE: Final = 0.02  # of the weight: so much must have expected a shape; only the right noses do
PER_ROW: Final = 2.1  # more of the gate for each row of what an image shows of a shape
MOST_EVIDENCE: Final = 40.0  # of the logarithm of a likelihood ratio, by one measurement
BOXES: Final = "boxes"  # the names of biases
POSES: Final = "poses"
ANY_NOSE: Final = 1.0  # as `edge_on`: of a leader whose range is measured, noise depends little on its nose


class Fit(NamedTuple):
    """The cloud after what an image shows of a shape, None if that fits no nose, with the particles' logarithms of
    likelihoods (K,), the NIS that OF_SHAPE of the weight have at most, and the named points that fit none."""

    cloud: Cloud | None
    log_l: Array
    beyond: float
    misfits: tuple[str, ...] = ()


def fitted(settings: NoseModel, cloud: Cloud, shows: ShapeFeatures, axes: Array, pose: CameraPose) -> Fit:
    """The cloud after what an image shows of the leader's shape. If all of it fits no nose, the points that fit
    none by themselves are left out: one point that a detector finds elsewhere costs the others nothing. Raises
    FilterError."""

    def fit(part: ShapeFeatures) -> Fit:
        found, nis, log_l = shaped(cloud, part, axes, pose)
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
    order = nis.argsort()
    least = float(nis[order[np.exp(cloud.log_weights[order]).cumsum().searchsorted(share)]])
    if not math.isfinite(least):
        raise FilterError("the cloud of noses has lost its numbers")
    return least


def informed(settings: NoseModel, cloud: Cloud, prior: Belief) -> Cloud | None:
    """The cloud with what was believed of position and velocity before, (6,) and (6, 6), in n; None where less
    than OF_SHAPE of its weight agrees: only the right noses do. Raises FilterError."""
    H = np.eye(cloud.means.shape[1])[MOTION]
    found, nis, log_l = corrected(cloud, H, prior.mean - cloud.means[:, MOTION], prior.covariance)
    if expected(cloud, nis, OF_SHAPE) > settings.gate:
        return None
    return weighted(found, log_l)


def corrected(
    cloud: Cloud, H: Array, innovations: Array, R_y: Array, considered: Sequence[int] = ()
) -> tuple[Cloud, Array, Array]:
    """The cloud after rows with derivatives H (m, W) or (K, m, W), innovations (K, m) and noise R_y (m, m), with
    each particle's NIS (K,) and logarithm of the likelihood (K,), without their common constant. The components
    that are `considered` stay as they are. Raises FilterError."""
    HP = H @ cloud.covariances
    S = HP @ np.swapaxes(H, -1, -2) + R_y
    try:
        gain = np.linalg.solve(S, HP).transpose(0, 2, 1)
        off = np.linalg.solve(S, innovations[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError as error:
        raise FilterError("the innovation's covariance is singular") from error
    nis = np.einsum("ki,ki->k", innovations, off)
    at = list(considered)
    gain[:, at] = 0.0
    means = cloud.means + np.einsum("kij,kj->ki", gain, innovations)
    P = cloud.covariances - gain @ HP
    P[:, at] = P[:, :, at].transpose(0, 2, 1)
    log_l = -0.5 * (nis + np.linalg.slogdet(S)[1])
    return cloud._replace(means=means, covariances=0.5 * (P + P.transpose(0, 2, 1))), nis, log_l


def weighted(cloud: Cloud, log_l: Array, believed: float = 1.0) -> Cloud:
    """The cloud with each particle's weight times its likelihood, of which these are the logarithms (K,), as far
    as that is `believed`, from 0 to 1."""
    return charged(cloud, believed * np.maximum(log_l, np.maximum.reduce(log_l) - MOST_EVIDENCE))


def charged(cloud: Cloud, log_l: Array) -> Cloud:
    """The cloud with each particle's weight times all of a likelihood, of which these are the logarithms (K,)."""
    log_weights = cloud.log_weights + log_l
    log_weights -= np.maximum.reduce(log_weights)  # the methods of an array cost as much again
    return cloud._replace(log_weights=log_weights - math.log(np.add.reduce(np.exp(log_weights))))


def shaped(cloud: Cloud, shows: ShapeFeatures, axes: Array, pose: CameraPose) -> tuple[Cloud, Array, Array]:
    """The cloud after what an image shows of the leader's shape, with each particle's NIS and log likelihood."""
    bias = 0
    if shows.is_box:
        cloud = cloud.with_biases(of_boxes(shows))
        bias = cloud.column(BOXES)
    noses, means, P = cloud.noses.copy(), cloud.means.copy(), cloud.covariances.copy()
    camera = pose.R_cn, pose.r_FC_n, axes
    nis, log_l = points.update(means, P, noses, shows.rows, shows.posture, camera, bias)
    return cloud._replace(noses=noses, means=means, covariances=P, tied=_still(cloud, noses)), nis, log_l


def of_boxes(shows: ShapeFeatures) -> Bias:
    """By how much boxes are too large, in the logarithm."""
    return Bias(BOXES, shows.bias)


def of_ranges(shows: PoseFeatures) -> Bias:
    """By how much the ranges of poses are too large, in the logarithm."""
    return Bias(POSES, shows.range_bias)


def posed(cloud: Cloud, shows: PoseFeatures, camera: CameraPose) -> tuple[Cloud, Array, Array]:
    """The cloud after a pose, with each particle's NIS and log likelihood."""
    nis, log_l, nose = np.zeros(len(cloud.noses)), np.zeros(len(cloud.noses)), shows.nose(camera)
    if shows.range_ is not None:
        cloud = cloud.with_biases(of_ranges(shows))
        bias = cloud.column(POSES)
        off = cloud.means[:, POSITION] - camera.r_FC_n
        distance = np.linalg.norm(off, axis=1)
        appears = distance * np.exp(cloud.means[:, bias])
        H = np.zeros((len(off), 1, cloud.means.shape[1]))
        H[:, 0, POSITION], H[:, 0, bias] = off * (appears / distance**2)[:, None], appears
        cloud, nis, log_l = corrected(
            cloud, H, (shows.range_ - appears)[:, None], np.array([[shows.range_sigma**2]])
        )
    noses, means, P = cloud.noses.copy(), cloud.means.copy(), cloud.covariances.copy()
    if nose is not None:
        log_l = log_l + apparent_pose.measure_nose(noses, means, P, *nose)
        cloud = cloud._replace(sided=True, misplaced=max(cloud.misplaced, TURN_BIAS))
    return cloud._replace(noses=noses, means=means, covariances=P, tied=_still(cloud, noses)), nis, log_l


def _still(cloud: Cloud, noses: Array) -> Array:
    """Which noses (K,) are still tied to their courses: not those that were measured elsewhere."""
    return np.where(noses == cloud.noses, cloud.tied, np.minimum(cloud.tied, FREE))
