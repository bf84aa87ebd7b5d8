"""Kernels of `filters.unscented_transform`: the arithmetic of `sigma_points` for one belief and for a batch.

As in `unscented`, the callers provide the arrays for the results of one belief.
"""

import numpy as np

from onboard.compiled import CONTRACTED, MAKING, kernel, signature
from onboard.filters.errors import (
    MEMBER_FACTOR,
    OK,
    Q_INDEFINITE_ERROR,
    SHAPE_ERROR,
    WEIGHT_SUM_TOLERANCE,
    WEIGHTS_ERROR,
)
from onboard.filters.kernels.cholesky import is_noise
from onboard.filters.kernels.sigma_points import gather_into, gather_scratch_shape, spread_into


@kernel(signature(1, 2, "f", "f", "f", "out"), **MAKING, **CONTRACTED)
def spread(mean, P, gamma, w_mean, w, points):
    """Fill sigma points into `points` (2n+1, n); return a status."""
    others = 2 * w * mean.shape[0]
    if abs(w_mean + others - 1) > WEIGHT_SUM_TOLERANCE * others:
        return WEIGHTS_ERROR
    return spread_into(mean, P, gamma, points)


@kernel(signature(2, "f", "f", "f", 2, "out"), **MAKING, **CONTRACTED)
def gather(points, w_mean, w_cov, w, Q, out):
    """Fill mean and covariance into the rows of `out` (1 + n, n); return a status."""
    scratch = np.empty(gather_scratch_shape(out.shape[1]))
    status = gather_into(points, w_mean, w_cov, w, Q, scratch, out[0], out[1:])
    return Q_INDEFINITE_ERROR if status == OK and not is_noise(Q, scratch) else status


# ---------------------------------------------------------------------------------- a batch of them


@kernel(signature("packed 2", "packed 3", "f"), **MAKING, **CONTRACTED)
def spread_batch(mean, P, gamma):
    """Return (points (B, 2n+1, n), the first status that is not OK)."""
    count, n = mean.shape
    points = np.empty((count, 2 * n + 1, n))
    if P.shape[0] != count:
        return points, SHAPE_ERROR
    for b in range(count):
        status = spread_into(mean[b], P[b], gamma, points[b])
        if status != OK:
            return points, status + MEMBER_FACTOR * b
    return points, OK


@kernel(signature("packed 3", "f", "f", "f", "packed 3"), **MAKING, **CONTRACTED)
def gather_batch(points, w_mean, w_cov, w, Q):
    """Return (mean (B, n), covariance (B, n, n), status); Q (B or 1, n, n)."""
    count, _, n = points.shape
    mean, P = np.empty((count, n)), np.empty((count, n, n))
    if Q.shape[0] != 1 and Q.shape[0] != count:
        return mean, P, SHAPE_ERROR
    scratch = np.empty(gather_scratch_shape(n))
    for b in range(count):
        status = gather_into(points[b], w_mean, w_cov, w, Q[b % Q.shape[0]], scratch, mean[b], P[b])
        if status == OK and (b == 0 or Q.shape[0] > 1) and not is_noise(Q[b % Q.shape[0]], scratch):
            status = Q_INDEFINITE_ERROR
        if status != OK:
            return mean, P, status + MEMBER_FACTOR * b
    return mean, P, OK
