"""Kernels of `filters.unscented`: the arithmetic of `sigma_points` for one filter, and for a batch of them.

For one filter microseconds count. Returning an array from machine code to Python takes four times as long as
creating it in Python, so the callers provide the arrays for the results.
"""

import numpy as np

from onboard.compiled import CONTRACTED, FILLING, FLAGS, MAKING, kernel, signature
from onboard.filters.errors import (
    COVARIANCE_ERROR,
    MEMBER_FACTOR,
    OK,
    POSTERIOR_ERROR,
    PREDICTED_ERROR,
    Q_INDEFINITE_ERROR,
    R_INDEFINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import is_noise
from onboard.filters.kernels.sigma_points import (
    CorrectedPoints,
    correct_into,
    correct_scratch_shape,
    gather_into,
    gather_scratch_shape,
    spread_into,
)


def scratch_size(n: int, m: int) -> int:
    """Return how many numbers `redraw` and `correct_and_redraw` need after the points and the covariance."""
    rows, width = correct_scratch_shape(n, m)
    height, length = gather_scratch_shape(n)
    return int(max(height * length, (rows + 2 + m) * width))


@kernel(signature(2, 1, 2, "out"), **FILLING, **CONTRACTED)
def redraw(moved, weights, Q, state):
    """Fill mean and covariance of the moved points, and new points of them, into `state`; return a status.

    The rows of `state` are the points (2n+1, n), the first of them the mean, and the covariance (n, n); those
    after are scratch. `weights` (4,) as in `Weights`.
    """
    n = state.shape[1]
    points, P = state[: 2 * n + 1], state[2 * n + 1 : 3 * n + 1]
    gamma, w_mean, w_cov, w = weights[0], weights[1], weights[2], weights[3]
    rows, width = gather_scratch_shape(n)
    scratch = state[3 * n + 1 :].reshape(-1)[: rows * width].reshape(rows, width)
    status = gather_into(moved, w_mean, w_cov, w, Q, scratch, points[0], P)
    if status == OK and not is_noise(Q, scratch):
        return Q_INDEFINITE_ERROR
    if status == OK:
        status = spread_into(points[0], P, gamma, points)
    return PREDICTED_ERROR if status == COVARIANCE_ERROR else status


@kernel(signature(2, 2, 2, 1, 2, "f", "f", FLAGS, FLAGS, "out", "out"), **MAKING, **CONTRACTED)
def correct(points, images, P, y, R, w_cov, w, angular, considered, out, found):
    """Fill mean and covariance into the rows of `out` (1 + n, n); return (status, NIS).

    Innovation, prediction and the covariance of the innovation go into the rows of `found` (2 + m, m).
    """
    scratch = np.empty(correct_scratch_shape(points.shape[1], y.shape[0]))
    into = CorrectedPoints(out[0], out[1:], found[0], found[2:], found[1])
    status, nis = correct_into(points, images, P, y, R, w_cov, w, angular, considered, scratch, into)
    return R_INDEFINITE_ERROR if status != SHAPE_ERROR and not is_noise(R, scratch) else status, nis


@kernel(signature("out", 2, 1, 2, 1, FLAGS), **FILLING, **CONTRACTED)
def correct_and_redraw(state, images, y, R, weights, masks):
    """Update a `state` of `redraw` in place; return (status, NIS).

    `masks` (m + n,) are those of angular components and of considered states.
    """
    n, m = state.shape[1], y.shape[0]
    if masks.shape[0] != m + n:
        return SHAPE_ERROR, 0.0
    gamma, w_cov, w = weights[0], weights[2], weights[3]
    points, P = state[: 2 * n + 1], state[2 * n + 1 : 3 * n + 1]
    rows, width = correct_scratch_shape(n, m)
    behind = state[3 * n + 1 :].reshape(-1)[: (rows + 2 + m) * width].reshape(rows + 2 + m, width)
    scratch, found = behind[:rows], behind[rows:, :m]
    angular, considered = masks[:m], masks[m:]
    innovation, predicted, S, mean = found[0], found[1], found[2:], points[0]
    into = CorrectedPoints(mean, P, innovation, S, predicted)  # each number is read before it is overwritten
    status, nis = correct_into(points, images, P, y, R, w_cov, w, angular, considered, scratch, into)
    if status != SHAPE_ERROR and not is_noise(R, scratch):
        return R_INDEFINITE_ERROR, nis
    if status == OK:
        status = spread_into(mean, P, gamma, points)
        if status == COVARIANCE_ERROR:
            status = POSTERIOR_ERROR
    return status, nis


# ---------------------------------------------------------------------------------- a batch of them


@kernel(
    signature("packed 3", 3, "packed 3", "packed 2", "packed 3", "f", "f", FLAGS, FLAGS), **MAKING, **CONTRACTED
)
def correct_batch(points, images, P, y, R, w_cov, w, angular, considered):
    """Like `correct`, each with a leading axis B; R (B or 1, m, m)."""
    count, _, n = points.shape
    m = y.shape[1]
    mean_out, P_out = np.empty((count, n)), np.empty((count, n, n))
    innovation, predicted = np.empty((count, m)), np.empty((count, m))
    S, nis = np.empty((count, m, m)), np.empty(count)
    if images.shape[0] != count or P.shape[0] != count or y.shape[0] != count or R.shape[0] not in (1, count):
        return mean_out, P_out, innovation, S, predicted, nis, SHAPE_ERROR
    scratch = np.empty(correct_scratch_shape(n, m))
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
            CorrectedPoints(mean_out[b], P_out[b], innovation[b], S[b], predicted[b]),
        )
        if status != SHAPE_ERROR and (b == 0 or R.shape[0] > 1) and not is_noise(R[b % R.shape[0]], scratch):
            status = R_INDEFINITE_ERROR
        if status != OK:
            return mean_out, P_out, innovation, S, predicted, nis, status + MEMBER_FACTOR * b
    return mean_out, P_out, innovation, S, predicted, nis, OK
