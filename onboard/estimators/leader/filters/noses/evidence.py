"""What a cloud of noses becomes by what an image shows beyond center and wing: a shape, or a pose.

Points and boxes show the range of a leader of the configured size; a pose alone shows the range itself. Each of
them has an error that lasts, which no number of images reduces. It is no part of the particles, but of the
summary; where another kind of image follows, it becomes uncertainty of each particle's range.
"""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.noses.cloud import Cloud
from onboard.estimators.leader.posed import LASTING_TURN, Posed
from onboard.estimators.leader.settings import NoseModel
from onboard.estimators.leader.shape import Seen
from onboard.models import apparent_pose, apparent_shape
from onboard.models.apparent_wing import LEAST_VISIBLE, R

LASTING: Final = 4.0  # noise that lasts counts as often
ANY_NOSE: Final = 1.0  # as `edge_on`: of a leader whose range is measured, noise depends little on its nose


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
    return cloud._replace(noses=noses, means=means, covariances=P), nis, log_l


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
    return cloud._replace(noses=noses, means=means, covariances=P), nis, log_l


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
