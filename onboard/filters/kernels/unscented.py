"""What the sigma-point filters call: the arithmetic of `_kernels` for one filter, and for a batch of them.

For one filter microseconds count. To hand an array from machine code to Python takes four times as long as to make
it in Python, so the callers bring the arrays for the results.
"""

import numpy as np
from numba import njit

from onboard.filters.belief import COVARIANCE, OK, POSTERIOR, PREDICTED, SHAPE
from onboard.filters.compiled import CONTRACTED, FILLING, MAKING
from onboard.filters.kernels.sigma_points import (
    FLAGS,
    correct_into,
    correct_room,
    gather_into,
    gather_room,
    signatures,
    spread_into,
)


def scratch_size(n: int, m: int) -> int:
    """How many numbers `redraw` and `correct_and_redraw` need behind the points and the covariance."""
    rows, width = correct_room(n, m)
    height, length = gather_room(n)
    return int(max(height * length, (rows + 2 + m) * width))


@njit(signatures(2, 1, 2, "out"), **FILLING, **CONTRACTED)
def redraw(moved, weights, Q, drawn):  # type: ignore[no-untyped-def]
    """Mean and covariance of the moved points, and new points of them: into the rows of `drawn` (2n+1 + n, n), and
    scratch, the points, of which the first is the mean, and the covariance; a status. `weights` (4,) as in
    `Weights`."""
    n = drawn.shape[1]
    points, P = drawn[: 2 * n + 1], drawn[2 * n + 1 : 3 * n + 1]
    gamma, w_mean, w_cov, w = weights[0], weights[1], weights[2], weights[3]
    rows, width = gather_room(n)
    scratch = drawn[3 * n + 1 :].reshape(-1)[: rows * width].reshape(rows, width)
    status = gather_into(moved, w_mean, w_cov, w, Q, scratch, points[0], P)
    if status == OK:
        status = spread_into(points[0], P, gamma, points)
    return PREDICTED if status == COVARIANCE else status


@njit(signatures(2, 2, 2, 1, 2, "f", "f", FLAGS, FLAGS, "out", "out"), **MAKING, **CONTRACTED)
def correct(points, images, P, y, R, w_cov, w, angular, considered, out, told):  # type: ignore[no-untyped-def]
    """Mean and covariance into the rows of `out` (1 + n, n); innovation, prediction and the covariance of the
    innovation into those of `told` (2 + m, m). (status, NIS)."""
    scratch = np.empty(correct_room(points.shape[1], y.shape[0]), points.dtype)
    return correct_into(
        points,
        images,
        P,
        y,
        R,
        w_cov,
        w,
        angular,
        considered,
        scratch,
        out[0],
        out[1:],
        told[0],
        told[2:],
        told[1],
    )


@njit(signatures("out", 2, 1, 2, 1, FLAGS), **FILLING, **CONTRACTED)
def correct_and_redraw(drawn, images, y, R, weights, marks):  # type: ignore[no-untyped-def]
    """Update in place of `drawn`, as `redraw` gives it; `marks` (m + n,) are those of angular components and of
    considered states. (status, NIS)."""
    n, m = drawn.shape[1], y.shape[0]
    if marks.shape[0] != m + n:
        return SHAPE, drawn.dtype.type(0)
    gamma, w_cov, w = weights[0], weights[2], weights[3]
    points, P = drawn[: 2 * n + 1], drawn[2 * n + 1 : 3 * n + 1]
    rows, width = correct_room(n, m)
    room = drawn[3 * n + 1 :].reshape(-1)[: (rows + 2 + m) * width].reshape(rows + 2 + m, width)
    scratch, told = room[:rows], room[rows:, :m]
    angular, considered = marks[:m], marks[m:]
    innovation, predicted, S, mean = told[0], told[1], told[2:], points[0]
    status, nis = correct_into(  # reads each number for the last time before it writes there
        points, images, P, y, R, w_cov, w, angular, considered, scratch, mean, P, innovation, S, predicted
    )
    if status == OK:
        status = spread_into(mean, P, gamma, points)
        if status == COVARIANCE:
            status = POSTERIOR
    return status, nis


# ---------------------------------------------------------------------------------- a batch of them


@njit(
    signatures("packed 3", 3, "packed 3", "packed 2", "packed 3", "f", "f", FLAGS, FLAGS), **MAKING, **CONTRACTED
)
def correct_batch(points, images, P, y, R, w_cov, w, angular, considered):  # type: ignore[no-untyped-def]
    """As `correct`, each with a leading axis B; R (B or 1, m, m)."""
    count, _, n = points.shape
    m = y.shape[1]
    dtype = points.dtype
    mean_out, P_out = np.empty((count, n), dtype), np.empty((count, n, n), dtype)
    innovation, predicted, S = (
        np.empty((count, m), dtype),
        np.empty((count, m), dtype),
        np.empty((count, m, m), dtype),
    )
    nis = np.empty(count, dtype)
    if images.shape[0] != count or P.shape[0] != count or y.shape[0] != count or R.shape[0] not in (1, count):
        return mean_out, P_out, innovation, S, predicted, nis, SHAPE
    scratch = np.empty(correct_room(n, m), dtype)
    for b in range(count):
        status, nis[b] = correct_into(
            points[b],
            images[b],
            P[b],
            y[b],
            R[b % R.shape[0]],
            w_cov,
            w,
            angular,
            considered,
            scratch,
            mean_out[b],
            P_out[b],
            innovation[b],
            S[b],
            predicted[b],
        )
        if status != OK:
            return mean_out, P_out, innovation, S, predicted, nis, status
    return mean_out, P_out, innovation, S, predicted, nis, OK
