"""Interacting unscented filters over `leader_flight`: a step of all modes in one compiled call.

The algorithm is `filters.multiple_model` over `filters.unscented`, which need some fifteen calls. For a single
target most of their time is spent on the way from Python to machine code and back. A test holds both to the same
numbers. B filters with r modes each advance in one call.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.filters.belief import OK, SHAPE, Belief, Update, Weights, mask, raise_status
from onboard.filters.compiled import CUBE, FLAGS, FOUR, ROWS
from onboard.filters.inline import (
    correct_into,
    correct_scratch_shape,
    gather_into,
    gather_scratch_shape,
    mix_into,
    pass_into,
    spread_into,
    weigh_into,
)
from onboard.models import wing_line
from onboard.models.leader_flight import ImageGeometry, measure_rows, process_rows, wing_axis
from onboard.models.relative_motion import SIZE

NUMBER: Final = types.float64
CLOSEST: Final = 1e-6  # m ahead of the camera: a nearer point is in no image


class Modes(NamedTuple):
    """The modes' means (B, r, n), covariances (B, r, n, n) and probabilities (B, r)."""

    means: Array
    covariances: Array
    probabilities: Array


class Step(NamedTuple):
    """What a prediction needs for each of r modes: `leader_flight.ModeParameters` as rows (r, 7), Q (r, n, n), and
    the probabilities (r, r) of changing from one mode (row) to another."""

    parameters: Array
    noises: Array
    transition: Array


def start(mean: Array, covariance: Array, probabilities: Array) -> Modes:
    """All modes with one belief, mean (B, n) and covariance (B, n, n), and `probabilities` (r,)."""
    count, r = len(mean), len(probabilities)
    return Modes(
        np.repeat(mean[:, None], r, axis=1),
        np.repeat(covariance[:, None], r, axis=1),
        np.repeat(probabilities[None], count, axis=0),
    )


def mixture(modes: Modes) -> Belief:
    """Mean (B, n) and covariance (B, n, n) of the mixture."""
    return Belief(*_mixture(*modes))


def predicted_points(modes: Modes, geometry: ImageGeometry, eps: float) -> Array:
    """Image points (B, 3, 2) of the mixture's mean, in focal lengths: center, left and right wingtip. NaN for a
    point behind the camera. `eps` as in `ModeParameters`."""
    points: Array = _predicted_points(modes.means, modes.probabilities, *geometry[:3], eps)
    return points


def predict(modes: Modes, step: Step, dt: float, v_F_n: Array, a_F_n: Array, weights: Weights) -> Modes:
    """The modes after `dt` seconds in which the followers, at first at v_F_n (B, 3), accelerate by a_F_n (B, 3).

    Raises FilterError, NotPositiveDefiniteError.
    """
    *after, status = _predict(*modes, *step, dt, v_F_n, a_F_n, *weights)
    if status:
        raise_status(status)
    return Modes(*after)


def update(
    modes: Modes,
    y: Array,
    R_y: Array,
    geometry: ImageGeometry,
    eps: float,
    weights: Weights,
    considered: tuple[int, ...],
) -> Update:
    """The update by measurements y (B, m) with noise R_y (B, m, m) (`models.wing_line`), whose wingtips are
    exchanged where that is nearer to the prediction. States `considered` stay as they are, with their uncertainty.
    The belief is of Modes; `innovation` and the rest are the mixture's.

    Raises FilterError, NotPositiveDefiniteError.
    """
    marks = mask((), y.shape[-1]), mask(considered, modes.means.shape[-1])
    *after, e, S, predicted, nis, status = _update(*modes, y, R_y, *geometry, eps, *weights, *marks)
    if status:
        raise_status(status)
    return Update(Modes(*after), e, S, predicted, nis)


@njit((CUBE, FOUR, ROWS), cache=True, error_model="numpy")
def _mixture(means, P, probabilities):  # type: ignore[no-untyped-def]
    count, _, n = means.shape
    mean_out, P_out = np.empty((count, n)), np.empty((count, n, n))
    for b in range(count):
        mix_into(means[b], P[b], probabilities[b], mean_out[b], P_out[b])
    return mean_out, P_out


PREDICT_SIGNATURE: Final = (CUBE, FOUR, ROWS, ROWS, CUBE, ROWS, NUMBER, ROWS, ROWS, *[NUMBER] * 4)


@njit(PREDICT_SIGNATURE, cache=True, error_model="numpy")
def _predict(  # type: ignore[no-untyped-def]
    means, P, prior, parameters, Q, transition, dt, v_F, a_F, gamma, w_mean, w_cov, w
):
    count, r, n = means.shape
    k = 2 * n + 1
    means_out, P_out, ahead = np.empty((count, r, n)), np.empty((count, r, n, n)), np.empty((count, r))
    mixing, mean, covariance = np.empty((r, r)), np.empty(n), np.empty((n, n))
    points, scratch = np.empty((r, count * k, n)), np.empty(gather_scratch_shape(n))
    if v_F.shape[0] != count or a_F.shape[0] != count or parameters.shape[0] != r or Q.shape[0] != r:
        return means_out, P_out, ahead, SHAPE
    for b in range(count):
        pass_into(prior[b], transition, ahead[b], mixing)
        for j in range(r):
            mix_into(means[b], P[b], mixing[:, j], mean, covariance)
            status = spread_into(mean, covariance, gamma, points[j, b * k : (b + 1) * k])
            if status != OK:
                return means_out, P_out, ahead, status
    for j in range(r):
        decay = np.exp(-dt / parameters[j, 1:6])
        rows = process_rows(points[j], dt, v_F, a_F, parameters[j, 0], decay, parameters[j, 6])
        for b in range(count):
            moved, mean_out = rows[b * k : (b + 1) * k], means_out[b, j]
            status = gather_into(moved, w_mean, w_cov, w, Q[j], scratch, mean_out, P_out[b, j])
            if status != OK:
                return means_out, P_out, ahead, status
    return means_out, P_out, ahead, OK


@njit((CUBE, ROWS, CUBE, ROWS, ROWS, NUMBER), cache=True, error_model="numpy")
def _predicted_points(means, weights, R_cn, r_FC, v_F, eps):  # type: ignore[no-untyped-def]
    count, r, n = means.shape
    points, x = np.full((count, 3, 2), np.nan), np.empty(n)
    for b in range(count):
        for i in range(n):
            x[i] = 0.0
            for k in range(r):
                x[i] += weights[b, k] * means[b, k, i]
        wing = wing_axis(x, x[3] + v_F[b, 0], x[4] + v_F[b, 1], x[5] + v_F[b, 2], eps)
        for p in range(3):
            half = 0.5 * x[SIZE] * (0.0, -1.0, 1.0)[p]
            for i in range(3):
                x[i] += half * wing[i] - r_FC[b, i]
            ahead = R_cn[b, 0, 0] * x[0] + R_cn[b, 0, 1] * x[1] + R_cn[b, 0, 2] * x[2]
            if ahead > CLOSEST:
                for i in range(2):
                    q = R_cn[b, 1 + i, 0] * x[0] + R_cn[b, 1 + i, 1] * x[1] + R_cn[b, 1 + i, 2] * x[2]
                    points[b, p, i] = q / ahead
            for i in range(3):
                x[i] -= half * wing[i] - r_FC[b, i]
    return points


@njit(cache=True, error_model="numpy")
def _spread_into(means, P, gamma, points):  # type: ignore[no-untyped-def]
    """Sigma points of all modes of all filters into `points` (B, r, 2n+1, n); a status."""
    count, r, _ = means.shape
    for b in range(count):
        for j in range(r):
            status = spread_into(means[b, j], P[b, j], gamma, points[b, j])
            if status != OK:
                return status
    return OK


@njit(cache=True, error_model="numpy")
def _correct_into(  # type: ignore[no-untyped-def]
    points, images, P, prior, y, R_y, w_cov, w, angular, considered, mean, P_out, after, innovation, S, predicted
):
    """The update of one filter by its modes' points (r, 2n+1, n) and their images (r, 2n+1, m); (status, NIS)."""
    r, _, n = points.shape
    m = len(y)
    scratch, log_l, each_nis = np.empty(correct_scratch_shape(n, m)), np.empty(r), np.empty(r)
    z, R_z, of_mode = np.empty(m), np.empty((m, m)), np.empty(m)
    e, covariances = np.empty((r, m)), np.empty((r, m, m))
    wing_line.order_tips_into(y, R_y, images[0, 0], z, R_z)
    for j in range(r):
        out = mean[j], P_out[j], e[j], covariances[j], of_mode
        status, each_nis[j] = correct_into(
            points[j], images[j], P[j], z, R_z, w_cov, w, angular, considered, scratch, *out
        )
        if status != OK:
            return status, 0.0
    status, nis = weigh_into(e, covariances, each_nis, prior, angular, log_l, after, innovation, S)
    predicted[:] = z - innovation
    return status, nis


GEOMETRY: Final = (CUBE, ROWS, ROWS, ROWS, CUBE)
UPDATE_SIGNATURE: Final = (CUBE, FOUR, ROWS, ROWS, CUBE, *GEOMETRY, *[NUMBER] * 5, FLAGS, FLAGS)


@njit(UPDATE_SIGNATURE, cache=True, error_model="numpy")
def _update(  # type: ignore[no-untyped-def]
    means, P, prior, y, R_y, R_cn, r_FC, v_F, omega_c, axes, eps, gamma, _w_mean, w_cov, w, angular, considered
):
    count, r, n = means.shape
    m, k = y.shape[1], 2 * n + 1
    means_out, P_out, posterior = np.empty((count, r, n)), np.empty((count, r, n, n)), np.empty((count, r))
    innovation, S = np.empty((count, m)), np.empty((count, m, m))
    predicted, nis = np.empty((count, m)), np.empty(count)
    points, status = np.empty((count, r, k, n)), SHAPE
    if y.shape[0] == R_y.shape[0] == R_cn.shape[0] == count:
        status = _spread_into(means, P, gamma, points)
    if status == OK:
        rows = measure_rows(points.reshape(count * r * k, n), R_cn, r_FC, v_F, omega_c, axes, eps, m)
        images = rows.reshape(count, r, k, m)
        for b in range(count):
            out = means_out[b], P_out[b], posterior[b], innovation[b], S[b], predicted[b]
            status, nis[b] = _correct_into(
                points[b], images[b], P[b], prior[b], y[b], R_y[b], w_cov, w, angular, considered, *out
            )
            if status != OK:
                break
    return means_out, P_out, posterior, innovation, S, predicted, nis, status
