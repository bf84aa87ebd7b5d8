"""Kernels of `filters.square_root`: the arithmetic of `triangularisation` for a batch and for single steps."""

import numpy as np

from onboard.compiled import FLAGS, MAKING, kernel, signature
from onboard.filters.errors import (
    FACTOR_ERROR,
    MATRIX_ERROR,
    MEMBER_FACTOR,
    OK,
    POSTERIOR_ERROR,
    PREDICTED_ERROR,
    R_INDEFINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import semifactor_into
from onboard.filters.kernels.factors import is_factor
from onboard.filters.kernels.linear import common_batch
from onboard.filters.kernels.triangularisation import (
    CorrectedFactor,
    Linearised,
    correct_into,
    gather_into,
    joseph_into,
    spread_into,
)


@kernel(signature(2, 3, "f"), **MAKING)
def spread(mean, L, gamma):
    """Return (points (B, 2n+1, n), status) from a mean and the lower triangle of the factor of its covariance."""
    count, n = common_batch((mean.shape[0], L.shape[0])), mean.shape[1]
    points = np.empty((max(count, 0), 2 * n + 1, n))
    if count < 0 or L.shape[1:] != (n, n):
        return points, SHAPE_ERROR
    for b in range(count):
        status = spread_into(mean[b % mean.shape[0]], L[b % L.shape[0]], gamma, points[b])
        if status != OK:
            return points, status + MEMBER_FACTOR * b
    return points, OK


@kernel(signature(3, 3, "f", "f"), **MAKING)
def gather(points, Q, w_cov, w):
    """Return (mean (B, n), factor (B, n, n), status) of points (B, 2n+1, n) plus noise Q."""
    count, _, n = points.shape
    mean, L = np.empty((count, n)), np.empty((count, n, n))
    if Q.shape[0] not in (1, count):
        return mean, L, SHAPE_ERROR
    extra, centre = np.empty((n, 2 * n + 1)), np.empty(n)
    no_angles = np.zeros(n, np.bool_)
    for b in range(count):
        status = gather_into(points[b], Q[b % Q.shape[0]], w_cov, w, no_angles, extra, centre, mean[b], L[b])
        if status != OK:
            return mean, L, status + MEMBER_FACTOR * b
    return mean, L, OK


@kernel(signature(3, 3, 3, 2, 3, "f", "f", FLAGS, FLAGS), **MAKING)
def correct(points, L, images, y, R, w_cov, w, angular, considered):
    """Update by triangularisation.

    Returns (mean, factor, gain K, U = K chol(S), innovation, its covariance, predicted, NIS, status), each over
    the batch; the classical form subtracts U from the prior's factor.
    """
    count, size, n = points.shape
    m = y.shape[1]
    mean_out, L_out = np.empty((count, n)), np.empty((count, n, n))
    K, U = np.empty((count, n, m)), np.empty((count, n, m))
    innovation, predicted = np.empty((count, m)), np.empty((count, m))
    S, nis = np.empty((count, m, m)), np.empty(count)
    fits = images.shape == (count, size, m) and y.shape[0] in (1, count) and L.shape[0] in (1, count)
    fits = fits and R.shape[0] in (1, count) and R.shape[1:] == (m, m)
    status = OK if fits else SHAPE_ERROR
    scratch = Linearised(np.empty((m, n)), np.empty((m, m)), np.empty((m, m)))
    for b in range(count):
        if status == OK:
            status, nis[b] = correct_into(
                points[b],
                L[b % L.shape[0]],
                images[b],
                y[b % y.shape[0]],
                R[b % R.shape[0]],
                w_cov,
                w,
                angular,
                considered,
                scratch,
                CorrectedFactor(mean_out[b], L_out[b], K[b], U[b], innovation[b], S[b], predicted[b]),
            )
            if status != OK:
                status += MEMBER_FACTOR * b
    return mean_out, L_out, K, U, innovation, S, predicted, nis, status


@kernel(signature(3, 3, 3, 3), **MAKING)
def joseph(L, H, K, R):
    """Return (tria[(I - K H) L, K S_R] (B, n, n), status): eqs 30-32 with a Jacobian H (B, m, n)."""
    count, n, m = K.shape
    out = np.empty((count, n, n))
    if H.shape != (count, m, n) or L.shape[0] not in (1, count):
        return out, SHAPE_ERROR
    HL, V = np.empty((m, n)), np.empty((m, m))
    for b in range(count):
        prior = L[b % L.shape[0]]
        if not semifactor_into(R[b % R.shape[0]], V):
            return out, R_INDEFINITE_ERROR + MEMBER_FACTOR * b
        for a in range(m):
            for j in range(n):
                HL[a, j] = 0.0
                for i in range(j, n):
                    HL[a, j] += H[b, a, i] * prior[i, j]
        joseph_into(prior, HL, K[b], V, out[b])
        if not is_factor(out[b], 0.0):
            return out, MATRIX_ERROR + MEMBER_FACTOR * b
    return out, OK


# ------------------------------------------------------------------- one filter, a step at a time (`stepping`)


@kernel(signature(2, 1, 2, "out"), **MAKING)
def redraw(moved, weights, Q, state):
    """Fill mean and factor of the moved points, and new points of them, into `state`; return a status.

    The rows of `state` (2n+1 + n, n) are the points, the first of them the mean, and the factor. `weights` (4,) as
    in `Weights`.
    """
    n = state.shape[1]
    points, L = state[: 2 * n + 1], state[2 * n + 1 :]
    extra, centre = np.empty((n, 2 * n + 1)), np.empty(n)
    status = gather_into(moved, Q, weights[2], weights[3], np.zeros(n, np.bool_), extra, centre, points[0], L)
    if status == OK:
        status = spread_into(points[0], L, weights[0], points)
    return PREDICTED_ERROR if status == FACTOR_ERROR else status


@kernel(signature("out", 2, 1, 2, 1, FLAGS), **MAKING)
def correct_and_redraw(state, images, y, R, weights, masks):
    """Update a `state` of `redraw` in place; return (status, NIS).

    `masks` (m + n,) are those of angular components and of considered states.
    """
    n, m = state.shape[1], y.shape[0]
    points, L = state[: 2 * n + 1], state[2 * n + 1 :]
    if masks.shape[0] != m + n or images.shape != (2 * n + 1, m) or R.shape != (m, m):
        return SHAPE_ERROR, 0.0
    scratch = np.empty((4 * m + 2 * n + 2, max(m, n)))
    linearised = Linearised(scratch[:m, :n], scratch[m : 2 * m, :m], scratch[2 * m : 3 * m, :m])
    S = scratch[3 * m : 4 * m, :m]
    K, U = scratch[4 * m : 4 * m + n, :m], scratch[4 * m + n : 4 * m + 2 * n, :m]
    innovation, predicted = scratch[4 * m + 2 * n, :m], scratch[4 * m + 2 * n + 1, :m]
    status, nis = correct_into(
        points,
        L,
        images,
        y,
        R,
        weights[2],
        weights[3],
        masks[:m],
        masks[m:],
        linearised,
        CorrectedFactor(points[0], L, K, U, innovation, S, predicted),
    )
    if status == OK:
        status = spread_into(points[0], L, weights[0], points)
    return POSTERIOR_ERROR if status == FACTOR_ERROR else status, nis
