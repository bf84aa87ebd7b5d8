"""Compiled arithmetic of the filters with matrices F and H: Kalman, extended, and statistically linear.

Every kernel is over a batch: its arguments have a leading axis of B, or of 1 (used for all of them), and one
filter is a batch of one.
"""

from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import BOOL, FILLING, FLAGS, MAKING, kernel, signature
from onboard.filters.errors import (
    COVARIANCE_ERROR,
    IMAGES_ERROR,
    INNOVATION_ERROR,
    MATRIX_ERROR,
    MEAN_ERROR,
    MEASUREMENT_ERROR,
    MEMBER_FACTOR,
    NONLINEAR_MEASURE_ERROR,
    NONLINEAR_PROCESS_ERROR,
    OK,
    POINTS_ERROR,
    Q_INDEFINITE_ERROR,
    Q_NOT_FINITE_ERROR,
    R_INDEFINITE_ERROR,
    R_NOT_FINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import factor_into, is_noise, root_into
from onboard.filters.kernels.sigma_points import wrapped


@kernel(**FILLING)
def is_finite(A):
    """Return whether a matrix is finite."""
    good = True
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            good &= np.isfinite(A[i, j])
    return good


@kernel(**MAKING)
def common_batch(sizes):
    """Return the batch size that a tuple of leading axes agrees on, or -1."""
    count = 1
    for size in sizes:
        if size != 1:
            if count not in (1, size):
                return -1
            count = size
    return count


@kernel(**FILLING)
def symmetric_into(A, out):
    """Fill the symmetric part of A (n, n), contiguous in memory."""
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            out[i, j] = 0.5 * (A[i, j] + A[j, i])


@kernel(**FILLING)
def add_product_into(A, C, out):
    """Add A C to out (m, k), of A (m, n) and C (n, k), as a sum of rows of C; zeros in A cost nothing."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            entry = A[i, j]
            if entry != 0:
                for c in range(C.shape[1]):
                    out[i, c] += entry * C[j, c]


@kernel(**MAKING)
def sandwich_into(F, P, Q, out):
    """Fill F P F^T + Q (m, m), symmetric to the last bit; return F P (m, n). F (m, n), P (n, n)."""
    FP = np.zeros(F.shape)
    add_product_into(F, P, FP)
    symmetric_into(Q, out)
    add_product_into(F, FP.T.copy(), out)
    for i in range(F.shape[0]):
        for j in range(i):
            out[i, j] = 0.5 * (out[i, j] + out[j, i])
            out[j, i] = out[i, j]
    return FP


@kernel(signature(3, 3, 3), **MAKING)
def propagate(P, F, Q):
    """Return (F P F^T + Q (B, n, n), status)."""
    count, n = common_batch((P.shape[0], F.shape[0], Q.shape[0])), P.shape[1]
    out = np.empty((max(count, 0), n, n))
    if count < 0 or P.shape[1:] != (n, n) or F.shape[1:] != (n, n) or Q.shape[1:] != (n, n):
        return out, SHAPE_ERROR
    prior = np.empty((n, n))
    for b in range(count):
        matrix, noise = F[b % F.shape[0]], Q[b % Q.shape[0]]
        symmetric_into(P[b % P.shape[0]], prior)
        if not root_into(prior, out[b]):
            return out, COVARIANCE_ERROR + MEMBER_FACTOR * b
        if not is_finite(matrix):
            return out, MATRIX_ERROR + MEMBER_FACTOR * b
        if b < Q.shape[0]:  # one for a whole batch is looked at once
            if not is_finite(noise):
                return out, Q_NOT_FINITE_ERROR + MEMBER_FACTOR * b
            if not is_noise(noise, out[b]):
                return out, Q_INDEFINITE_ERROR + MEMBER_FACTOR * b
        sandwich_into(matrix, prior, noise, out[b])
    return out, OK


@kernel(signature(2), **MAKING)
def corners(mean):
    """Return (points (B, n+3, n), OK) that determine an affine function and test for another one.

    They are the origin, one on each axis, the mean, and one more where no curved function is likely to have the
    value that the others predict.
    """
    count, n = mean.shape
    points = np.zeros((count, n + 3, n))
    for b in range(count):
        for i in range(n):
            points[b, 1 + i, i] = 1.0
            points[b, n + 1, i] = mean[b, i]
            points[b, n + 2, i] = -1.5 - 0.125 * i
    return points, OK


@kernel(signature(3, 3, FLAGS, BOOL), **MAKING)
def affine(points, images, angular, is_measure):
    """Return (matrix (B, m, n), value at the mean (B, m), status) from the images (B, n+3, m) of `corners`."""
    count, size, n = points.shape
    m = images.shape[2]
    matrix, value = np.empty((count, m, n)), np.empty((count, m))
    if images.shape[0] != count or images.shape[1] != size:
        return matrix, value, SHAPE_ERROR
    allowed = np.sqrt(np.finfo(np.float64).eps)
    for b in range(count):
        for a in range(m):
            value[b, a] = images[b, n + 1, a]
            for i in range(n):
                matrix[b, a, i] = images[b, 1 + i, a] - images[b, 0, a]
            for s in range(n + 1, n + 3):
                off, size_of = images[b, s, a] - images[b, 0, a], abs(images[b, 0, a]) + abs(images[b, s, a])
                for i in range(n):
                    part = matrix[b, a, i] * points[b, s, i]
                    off, size_of = off - part, size_of + abs(part)
                if angular[a]:
                    off = wrapped(off)
                if not np.isfinite(off):
                    return matrix, value, (IMAGES_ERROR if is_measure else POINTS_ERROR) + MEMBER_FACTOR * b
                if abs(off) > allowed * size_of:
                    return (
                        matrix,
                        value,
                        (NONLINEAR_MEASURE_ERROR if is_measure else NONLINEAR_PROCESS_ERROR) + MEMBER_FACTOR * b,
                    )
    return matrix, value, OK


@kernel(**MAKING)
def joseph_into(P, H, K, R, out):
    """Fill (I - K H) P (I - K H)^T + K R K^T (n, n), right for every gain K (n, m)."""
    n = K.shape[0]
    KH, G, KRK = np.zeros((n, n)), np.empty((n, n)), np.empty((n, n))
    add_product_into(K, H, KH)
    for i in range(n):
        for j in range(n):
            G[i, j] = (1.0 if i == j else 0.0) - KH[i, j]
    sandwich_into(K, R, np.zeros((n, n)), KRK)
    sandwich_into(G, P, KRK, out)


@kernel(**FILLING)
def solve_into(lower_t, rows):
    """Replace rows (k, m) by rows (L L^T)^-1, with L's transpose (m, m)."""
    m = lower_t.shape[0]
    for i in range(rows.shape[0]):
        for a in range(m):
            for b in range(a):
                rows[i, a] -= lower_t[b, a] * rows[i, b]
            rows[i, a] /= lower_t[a, a]
        for a in range(m - 1, -1, -1):
            for b in range(a + 1, m):
                rows[i, a] -= lower_t[a, b] * rows[i, b]
            rows[i, a] /= lower_t[a, a]


@kernel(**FILLING)
def innovate_into(y, predicted, angular, innovation):
    """Fill y - predicted, with angles wrapped; return a status."""
    for a in range(y.shape[0]):
        z = y[a] - predicted[a]
        innovation[a] = wrapped(z) if angular[a] else z
        if not np.isfinite(predicted[a]):
            return IMAGES_ERROR
        if not np.isfinite(z):
            return MEASUREMENT_ERROR
    return OK


class Corrected(NamedTuple):
    """Outputs of `correct_into`: mean (n,), covariance (n, n), innovation (m,) and its covariance (m, m)."""

    mean: Array
    covariance: Array
    innovation: Array
    S: Array


@kernel(**MAKING)
def correct_into(mean, P, H, predicted, y, R, angular, considered, out):
    """Update one filter by matrices into `out`; return (status, NIS)."""
    n, m = mean.shape[0], y.shape[0]
    mean_out, P_out, innovation, S = out
    for i in range(n):
        if not np.isfinite(mean[i]):
            return MEAN_ERROR, 0.0
    status = innovate_into(y, predicted, angular, innovation)
    if status != OK:
        return status, 0.0
    prior = np.empty((n, n))
    symmetric_into(P, prior)
    if not root_into(prior, P_out):
        return COVARIANCE_ERROR, 0.0
    if not is_finite(H) or not is_finite(R):
        return R_NOT_FINITE_ERROR if is_finite(H) else MATRIX_ERROR, 0.0
    HP = sandwich_into(H, prior, R, S)
    lower_t = np.empty((m, m))
    if not is_noise(R, lower_t):
        return R_INDEFINITE_ERROR, 0.0
    if not factor_into(S, lower_t):
        return INNOVATION_ERROR, 0.0
    K = HP.T.copy()
    for i in range(n):
        if considered[i]:
            K[i] = 0
    solve_into(lower_t, K)
    for i in range(n):
        mean_out[i] = mean[i]
        for a in range(m):
            mean_out[i] += K[i, a] * innovation[a]
    joseph_into(prior, H, K, R, P_out)
    weighed = np.empty((1, m))
    weighed[0] = innovation
    solve_into(lower_t, weighed)
    nis = 0.0
    for a in range(m):
        nis += weighed[0, a] * innovation[a]
    return OK, nis


@kernel(signature(2, 3, 3, 2, 2, 3, FLAGS, FLAGS), **MAKING)
def correct(mean, P, H, predicted, y, R, angular, considered):
    """Return (mean, covariance, innovation, its covariance, NIS, status), each over the batch."""
    n, m = mean.shape[1], y.shape[1]
    count = common_batch((mean.shape[0], P.shape[0], H.shape[0], predicted.shape[0], y.shape[0], R.shape[0]))
    size = max(count, 0)
    mean_out, P_out = np.empty((size, n)), np.empty((size, n, n))
    innovation, S = np.empty((size, m)), np.empty((size, m, m))
    nis = np.empty(size)
    fits = P.shape[1:] == (n, n) and H.shape[1:] == (m, n) and R.shape[1:] == (m, m)
    if count < 0 or not fits or predicted.shape[1] != m:
        return mean_out, P_out, innovation, S, nis, SHAPE_ERROR
    for b in range(count):
        status, nis[b] = correct_into(
            mean[b % mean.shape[0]],
            P[b % P.shape[0]],
            H[b % H.shape[0]],
            predicted[b % predicted.shape[0]],
            y[b % y.shape[0]],
            R[b % R.shape[0]],
            angular,
            considered,
            Corrected(mean_out[b], P_out[b], innovation[b], S[b]),
        )
        if status != OK:
            return mean_out, P_out, innovation, S, nis, status + MEMBER_FACTOR * b
    return mean_out, P_out, innovation, S, nis, OK
