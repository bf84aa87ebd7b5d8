"""Compiled arithmetic of the filters that work with matrices F and H: Kalman, extended, and statistically linear.

Every kernel is over a batch: its arguments have a leading axis of B or of 1 (used for all of them), and one
filter is a batch of one. Signatures and cache as in `_kernels`; Numba keeps a function's machine code until its
own file changes, so after an edit of `_kernels` touch this file too.
"""

import numpy as np
from numba import njit

from onboard.filters._kernels import FLAGS, factor_into, wrapped
from onboard.filters._kernels import _signatures as signatures
from onboard.filters.belief import (
    COVARIANCE,
    IMAGES,
    INNOVATION,
    MATRIX,
    MEAN,
    MEASUREMENT,
    NOISE,
    OK,
    SHAPE,
)
from onboard.filters.compiled import FILLING


@njit(**FILLING)
def semifactor_into(A, lower):  # type: ignore[no-untyped-def]
    """Cholesky factor (n, n) of the symmetric part of A, which may be singular; False if it is indefinite or not
    finite. A pivot lost in rounding gives a column of zeros: process noise often has rank one."""
    n = A.shape[0]
    tolerance = A.dtype.type(4 * n) * np.finfo(A.dtype).eps
    half = A.dtype.type(0.5)
    for j in range(n):
        for i in range(n):
            lower[i, j] = half * (A[i, j] + A[j, i]) if i >= j else 0.0
        for k in range(j):
            for i in range(j, n):
                lower[i, j] -= lower[j, k] * lower[i, k]
        pivot, allowed = lower[j, j], tolerance * abs(A[j, j])
        if not (pivot >= -allowed and pivot < np.inf):
            return False
        if pivot <= allowed:
            # what is left of a semi-definite matrix beside a zero pivot is zero; more than rounding is indefinite
            for i in range(j + 1, n):
                if not lower[i, j] * lower[i, j] <= (allowed + tolerance * A[j, j]) * abs(A[i, i]):
                    return False
                lower[i, j] = 0.0
            lower[j, j] = 0.0
            continue
        root = np.sqrt(pivot)
        lower[j, j] = root
        for i in range(j + 1, n):
            lower[i, j] /= root
    return True


@njit(**FILLING)
def finite(A):  # type: ignore[no-untyped-def]
    """Whether a matrix is finite."""
    good = True
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            good &= np.isfinite(A[i, j])
    return good


@njit(cache=True, error_model="numpy")
def common(sizes):  # type: ignore[no-untyped-def]
    """The batch size that a tuple of leading axes agrees on, or -1."""
    count = 1
    for size in sizes:
        if size != 1:
            if count not in (1, size):
                return -1
            count = size
    return count


@njit(cache=True, error_model="numpy")
def sandwich_into(F, P, Q, out):  # type: ignore[no-untyped-def]
    """F P F^T + Q (m, m), symmetric to the last bit; F (m, n), P (n, n)."""
    m, n = F.shape
    half = P.dtype.type(0.5)
    FP = np.zeros((m, n), P.dtype)
    for i in range(m):
        for k in range(n):
            if F[i, k] != 0:
                for j in range(n):
                    FP[i, j] += F[i, k] * P[k, j]
    for i in range(m):
        for j in range(m):
            out[i, j] = half * (Q[i, j] + Q[j, i])
            for k in range(n):
                out[i, j] += FP[i, k] * F[j, k]
    for i in range(m):
        for j in range(i):
            out[i, j] = half * (out[i, j] + out[j, i])
            out[j, i] = out[i, j]


@njit(signatures(3, 3, 3), cache=True, error_model="numpy")
def propagate(P, F, Q):  # type: ignore[no-untyped-def]
    """(F P F^T + Q (B, n, n), status)."""
    count, n = common((P.shape[0], F.shape[0], Q.shape[0])), P.shape[1]
    out = np.empty((max(count, 0), n, n), P.dtype)
    if count < 0 or P.shape[1:] != (n, n) or F.shape[1:] != (n, n) or Q.shape[1:] != (n, n):
        return out, SHAPE
    lower = np.empty((n, n), P.dtype)
    for b in range(count):
        prior, matrix, noise = P[b % P.shape[0]], F[b % F.shape[0]], Q[b % Q.shape[0]]
        if not semifactor_into(prior, lower):
            return out, COVARIANCE
        if not finite(matrix):
            return out, MATRIX
        if not finite(noise):
            return out, NOISE
        sandwich_into(matrix, prior, noise, out[b])
    return out, OK


@njit(cache=True, error_model="numpy")
def joseph_into(P, H, K, R, out):  # type: ignore[no-untyped-def]
    """(I - K H) P (I - K H)^T + K R K^T (n, n), right for every gain K (n, m)."""
    n, m = K.shape
    G = np.zeros((n, n), P.dtype)
    KRK = np.empty((n, n), P.dtype)
    sandwich_into(K, R, np.zeros((n, n), P.dtype), KRK)
    for i in range(n):
        for a in range(m):
            for j in range(n):
                G[i, j] -= K[i, a] * H[a, j]
        G[i, i] += P.dtype.type(1)
    sandwich_into(G, P, KRK, out)


@njit(**FILLING)
def solve_into(lower_t, rows):  # type: ignore[no-untyped-def]
    """rows (k, m) := rows (L L^T)^-1 in place, with L's transpose (m, m)."""
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


@njit(**FILLING)
def innovate_into(y, predicted, angular, innovation):  # type: ignore[no-untyped-def]
    """y - predicted, wrapped where it is an angle; a status."""
    for a in range(y.shape[0]):
        z = y[a] - predicted[a]
        innovation[a] = wrapped(z) if angular[a] else z
        if not np.isfinite(predicted[a]):
            return IMAGES
        if not np.isfinite(z):
            return MEASUREMENT
    return OK


@njit(cache=True, error_model="numpy")
def correct_into(  # type: ignore[no-untyped-def] # noqa: PLR0912 - loops
    mean, P, H, predicted, y, R, angular, considered, mean_out, P_out, innovation, S
):
    """Measurement update of one filter by matrices; (status, NIS)."""
    n, m = mean.shape[0], y.shape[0]
    for i in range(n):
        if not np.isfinite(mean[i]):
            return MEAN, P.dtype.type(0)
    status = innovate_into(y, predicted, angular, innovation)
    if status != OK:
        return status, P.dtype.type(0)
    if not semifactor_into(P, P_out):
        return COVARIANCE, P.dtype.type(0)
    if not finite(H):
        return MATRIX, P.dtype.type(0)
    if not finite(R):
        return NOISE, P.dtype.type(0)
    sandwich_into(H, P, R, S)
    lower_t = np.empty((m, m), P.dtype)
    if not factor_into(S, lower_t):
        return INNOVATION, P.dtype.type(0)
    K = np.zeros((n, m), P.dtype)
    for i in range(n):
        if not considered[i]:
            for a in range(m):
                for j in range(n):
                    K[i, a] += P[i, j] * H[a, j]
    solve_into(lower_t, K)
    for i in range(n):
        mean_out[i] = mean[i]
        for a in range(m):
            mean_out[i] += K[i, a] * innovation[a]
    joseph_into(P, H, K, R, P_out)
    weighed = np.empty((1, m), P.dtype)
    weighed[0] = innovation
    solve_into(lower_t, weighed)
    nis = P.dtype.type(0)
    for a in range(m):
        nis += weighed[0, a] * innovation[a]
    return OK, nis


@njit(signatures(2, 3, 3, 2, 2, 3, FLAGS, FLAGS), cache=True, error_model="numpy")
def correct(mean, P, H, predicted, y, R, angular, considered):  # type: ignore[no-untyped-def]
    """(mean, covariance, innovation, its covariance, NIS, status), each over the batch."""
    n, m = mean.shape[1], y.shape[1]
    count = common((mean.shape[0], P.shape[0], H.shape[0], predicted.shape[0], y.shape[0], R.shape[0]))
    size = max(count, 0)
    mean_out, P_out = np.empty((size, n), P.dtype), np.empty((size, n, n), P.dtype)
    innovation, S = np.empty((size, m), P.dtype), np.empty((size, m, m), P.dtype)
    nis = np.empty(size, P.dtype)
    fits = P.shape[1:] == (n, n) and H.shape[1:] == (m, n) and R.shape[1:] == (m, m)
    if count < 0 or not fits or predicted.shape[1] != m:
        return mean_out, P_out, innovation, S, nis, SHAPE
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
            mean_out[b],
            P_out[b],
            innovation[b],
            S[b],
        )
        if status != OK:
            return mean_out, P_out, innovation, S, nis, status
    return mean_out, P_out, innovation, S, nis, OK
