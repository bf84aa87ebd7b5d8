"""Compiled arithmetic of the sigma-point filters: plain loops over one filter, and over a batch of them.

The signatures are given, so that nothing is ever compiled in flight: it happens when this module is first imported
on a computer (`onboard compile` does it ahead), and the machine code is kept on disk. Arguments are declared
read-only and of any stride, which spares callers copies and Numba one compilation for each combination.

Sigma-point sets are symmetric with equal weights but for the centre's, so three numbers describe the weights.
`NUMBA_DISABLE_JIT=1` runs the same code in Python.
"""

from typing import Any, Final

import numpy as np
from numba import njit, types

from onboard.filters.belief import (
    COVARIANCE,
    IMAGES,
    INNOVATION,
    MEAN,
    MEASUREMENT,
    NOISE,
    OK,
    POINTS,
    SHAPE,
)

TWO_PI: Final = 2.0 * np.pi


def _in(dtype: Any, ndim: int) -> Any:
    return types.Array(dtype, ndim, "A", readonly=True)


def _signatures(*arguments: Any) -> list[Any]:
    """The signatures for both precisions; an int stands for an array of so many dimensions, "f" for a number."""
    made = []
    for dtype in (types.float64, types.float32):
        kinds = [_in(dtype, a) if isinstance(a, int) else dtype if a == "f" else a for a in arguments]
        made.append(tuple(kinds))
    return made


FLAGS: Final = types.Array(types.boolean, 1, "A", readonly=True)


@njit(cache=True, error_model="numpy")
def factor_into(A, lower_t):  # type: ignore[no-untyped-def]
    """Cholesky factor of A (n, n), transposed, into `lower_t` (n, n): row j is column j of the lower factor.
    False if A is not positive definite or not finite. Only A's upper triangle is read."""
    n = A.shape[0]
    for j in range(n):
        for i in range(j, n):
            lower_t[j, i] = A[j, i]
        for k in range(j):
            f = lower_t[k, j]
            for i in range(j, n):
                lower_t[j, i] -= f * lower_t[k, i]
        pivot = lower_t[j, j]
        if not (pivot > 0.0 and pivot < np.inf):
            return False
        root = np.sqrt(pivot)
        inverse = 1.0 / root
        lower_t[j, j] = root
        for i in range(j + 1, n):
            lower_t[j, i] *= inverse
        for i in range(j):
            lower_t[j, i] = 0.0
    return True


@njit(cache=True, error_model="numpy")
def spread_into(mean, P, gamma, points):  # type: ignore[no-untyped-def]
    """Sigma points of one filter into `points` (2n+1, n); a status."""
    n = mean.shape[0]
    if P.shape[0] != n or P.shape[1] != n:
        return SHAPE
    for i in range(n):
        if not np.isfinite(mean[i]):
            return MEAN
        points[0, i] = mean[i]
    if not factor_into(P, points[1 : n + 1]):
        return COVARIANCE
    for j in range(1, n + 1):
        for i in range(n):
            offset = gamma * points[j, i]
            points[j, i] = mean[i] + offset
            points[n + j, i] = mean[i] - offset
    return OK


@njit(cache=True, error_model="numpy")
def gather_into(points, w_mean, w_cov, w, Q, mean, P):  # type: ignore[no-untyped-def]
    """Weighted mean and covariance, plus Q, of one filter's points (2n+1, n); a status."""
    k, n = points.shape
    if k != 2 * n + 1 or Q.shape[0] != n or Q.shape[1] != n:
        return SHAPE
    d = np.empty((n, k), points.dtype)  # one row per component: the sums below then run along memory
    for i in range(n):
        total = points[1, i]
        for s in range(2, k):
            total += points[s, i]
        mean[i] = w * total + w_mean * points[0, i]
        if not np.isfinite(mean[i]):
            return POINTS
        for s in range(k):
            d[i, s] = points[s, i] - mean[i]
    status = OK
    for i in range(n):
        for j in range(i, n):
            total = d[i, 1] * d[j, 1]
            for s in range(2, k):
                total += d[i, s] * d[j, s]
            value = w * total + w_cov * d[i, 0] * d[j, 0] + 0.5 * (Q[i, j] + Q[j, i])
            if not np.isfinite(value):
                status = NOISE
            P[i, j] = value
            P[j, i] = value
    return status


@njit(cache=True, error_model="numpy")
def wrapped(x):  # type: ignore[no-untyped-def]
    """An angle in [-pi, pi]."""
    return x - TWO_PI * np.rint(x * (1.0 / TWO_PI))


@njit(cache=True, error_model="numpy")
def correct_into(  # type: ignore[no-untyped-def] # noqa: PLR0912 - loops
    points, images, P, y, R, w_cov, w, angular, considered, mean_out, P_out, innovation, S, predicted
):
    """Measurement update of one filter from its points (2n+1, n) and their images (2n+1, m); (status, NIS)."""
    k, n = points.shape
    m = y.shape[0]
    if images.shape[0] != k or images.shape[1] != m or R.shape[0] != m or R.shape[1] != m:
        return SHAPE, 0.0
    d = np.empty((k, m), points.dtype)
    for a in range(m):  # relative to the centre's image, so that a mean of angles does not break at +-pi
        total = 0.0
        for s in range(k):
            difference = images[s, a] - images[0, a]
            if angular[a]:
                difference = wrapped(difference)
            d[s, a] = difference
            if s > 0:
                total += difference
        shift = w * total
        predicted[a] = images[0, a] + shift
        for s in range(k):
            d[s, a] -= shift
        z = y[a] - predicted[a]
        if angular[a]:
            z = wrapped(z)
        innovation[a] = z
        if not np.isfinite(predicted[a]):
            return IMAGES, 0.0
        if not np.isfinite(z):
            return MEASUREMENT, 0.0
    cross = np.zeros((m, n), points.dtype)  # transposed: (m, n)
    for a in range(m):
        for b in range(a, m):
            total = 0.0
            for s in range(1, k):
                total += d[s, a] * d[s, b]
            S[a, b] = w * total + w_cov * d[0, a] * d[0, b] + 0.5 * (R[a, b] + R[b, a])
            S[b, a] = S[a, b]
        for s in range(1, n + 1):  # the centre's own deviation is zero, and the set is symmetric
            f = w * (d[s, a] - d[n + s, a])
            for i in range(n):
                cross[a, i] += f * (points[s, i] - points[0, i])
    L_t = np.empty((m, m), points.dtype)
    if not factor_into(S, L_t):
        return INNOVATION, 0.0
    # whiten: z = L^-1 innovation, half = L^-1 cross (m, n), so that K S K^T = half^T half
    z_white = np.empty(m, points.dtype)
    nis = 0.0
    for a in range(m):
        value = innovation[a]
        for b in range(a):
            value -= L_t[b, a] * z_white[b]
            for i in range(n):
                cross[a, i] -= L_t[b, a] * cross[b, i]
        inverse = 1.0 / L_t[a, a]
        z_white[a] = value * inverse
        nis += z_white[a] * z_white[a]
        for i in range(n):
            cross[a, i] *= inverse
    for i in range(n):
        step = 0.0
        if not considered[i]:
            for a in range(m):
                step += cross[a, i] * z_white[a]
        mean_out[i] = points[0, i] + step
        for j in range(i, n):
            reduction = 0.0
            if not (considered[i] and considered[j]):
                for a in range(m):
                    reduction += cross[a, i] * cross[a, j]
            value = 0.5 * (P[i, j] + P[j, i]) - reduction
            P_out[i, j] = value
            P_out[j, i] = value
    return OK, nis


# ------------------------------------------------------------------------------------- one filter


@njit(_signatures(2), cache=True, error_model="numpy")
def factor(A):  # type: ignore[no-untyped-def]
    """(transposed Cholesky factor (n, n), whether there is one)."""
    lower_t = np.empty(A.shape, A.dtype)
    return lower_t, factor_into(A, lower_t)


@njit(_signatures(1, 2, "f"), cache=True, error_model="numpy")
def spread(mean, P, gamma):  # type: ignore[no-untyped-def]
    """(points (2n+1, n), status)."""
    n = mean.shape[0]
    points = np.empty((2 * n + 1, n), mean.dtype)
    return points, spread_into(mean, P, gamma, points)


@njit(_signatures(2, "f", "f", "f", 2), cache=True, error_model="numpy")
def gather(points, w_mean, w_cov, w, Q):  # type: ignore[no-untyped-def]
    """(mean (n,), covariance (n, n), status)."""
    n = points.shape[1]
    mean, P = np.empty(n, points.dtype), np.empty((n, n), points.dtype)
    return mean, P, gather_into(points, w_mean, w_cov, w, Q, mean, P)


@njit(_signatures(2, 2, 2, 1, 2, "f", "f", FLAGS, FLAGS), cache=True, error_model="numpy")
def correct(points, images, P, y, R, w_cov, w, angular, considered):  # type: ignore[no-untyped-def]
    """(mean, covariance, innovation, its covariance, predicted, NIS, status)."""
    n, m = points.shape[1], y.shape[0]
    mean_out, P_out = np.empty(n, points.dtype), np.empty((n, n), points.dtype)
    innovation, predicted, S = np.empty(m, points.dtype), np.empty(m, points.dtype), np.empty((m, m), points.dtype)
    status, nis = correct_into(
        points, images, P, y, R, w_cov, w, angular, considered, mean_out, P_out, innovation, S, predicted
    )
    return mean_out, P_out, innovation, S, predicted, nis, status


# ---------------------------------------------------------------------------------- a batch of them


@njit(_signatures(2, 3, "f"), cache=True, error_model="numpy")
def spread_batch(mean, P, gamma):  # type: ignore[no-untyped-def]
    """(points (B, 2n+1, n), the first status that is not OK)."""
    count, n = mean.shape
    points = np.empty((count, 2 * n + 1, n), mean.dtype)
    if P.shape[0] != count:
        return points, SHAPE
    for b in range(count):
        status = spread_into(mean[b], P[b], gamma, points[b])
        if status != OK:
            return points, status
    return points, OK


@njit(_signatures(3, "f", "f", "f", 3), cache=True, error_model="numpy")
def gather_batch(points, w_mean, w_cov, w, Q):  # type: ignore[no-untyped-def]
    """(mean (B, n), covariance (B, n, n), status); Q (B or 1, n, n)."""
    count, _, n = points.shape
    mean, P = np.empty((count, n), points.dtype), np.empty((count, n, n), points.dtype)
    if Q.shape[0] != 1 and Q.shape[0] != count:
        return mean, P, SHAPE
    for b in range(count):
        status = gather_into(points[b], w_mean, w_cov, w, Q[b % Q.shape[0]], mean[b], P[b])
        if status != OK:
            return mean, P, status
    return mean, P, OK


@njit(_signatures(3, 3, 3, 2, 3, "f", "f", FLAGS, FLAGS), cache=True, error_model="numpy")
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
            mean_out[b],
            P_out[b],
            innovation[b],
            S[b],
            predicted[b],
        )
        if status != OK:
            return mean_out, P_out, innovation, S, predicted, nis, status
    return mean_out, P_out, innovation, S, predicted, nis, OK
