"""Compiled arithmetic of the square-root filters: sigma points from a factor, and the updates made of
triangularisations.

Precision, batches and cache as in `_kernels_factor`.
"""

import numpy as np
from numba import njit

from onboard.filters._kernels import FLAGS
from onboard.filters._kernels import _signatures as signatures
from onboard.filters._kernels_factor import downdate_into, sound, tria_into
from onboard.filters._kernels_linear import common, innovate_into, semifactor_into
from onboard.filters._kernels_slopes import centred_into, without
from onboard.filters.belief import (
    DOWNDATE,
    FACTOR,
    IMAGES,
    INDEFINITE,
    INNOVATION,
    MATRIX,
    MEAN,
    OK,
    POINTS,
    SHAPE,
)


@njit(signatures(2, 3, "f"), cache=True, error_model="numpy")
def spread(mean, L, gamma):  # type: ignore[no-untyped-def]
    """(points (B, 2n+1, n), status) from a mean and the factor of its covariance (only the lower triangle)."""
    count, n = common((mean.shape[0], L.shape[0])), mean.shape[1]
    points = np.empty((max(count, 0), 2 * n + 1, n), mean.dtype)
    if count < 0 or L.shape[1:] != (n, n):
        return points, SHAPE
    for b in range(count):
        centre, lower = mean[b % mean.shape[0]], L[b % L.shape[0]]
        if not sound(lower):
            return points, FACTOR
        for i in range(n):
            if not np.isfinite(centre[i]):
                return points, MEAN
            points[b, 0, i] = centre[i]
            for j in range(n):
                offset = gamma * lower[i, j] if j <= i else mean.dtype.type(0)
                points[b, 1 + j, i] = centre[i] + offset
                points[b, 1 + n + j, i] = centre[i] - offset
    return points, OK


@njit(signatures(3, 3, "f", "f"), cache=True, error_model="numpy")
def gather(points, Q, w_cov, w):  # type: ignore[no-untyped-def]
    """(mean (B, n), factor (B, n, n), status) of points (B, 2n+1, n) plus noise Q (eqs 20-22)."""
    count, size, n = points.shape
    mean, L = np.empty((count, n), points.dtype), np.empty((count, n, n), points.dtype)
    if Q.shape[0] not in (1, count) or Q.shape[1:] != (n, n) or size != 2 * n + 1:
        return mean, L, SHAPE
    extra, centre = np.empty((n, size), points.dtype), np.empty(n, points.dtype)
    angular = np.zeros(n, np.bool_)
    root, root_centre = np.sqrt(w), np.sqrt(abs(w_cov))
    for b in range(count):
        if not centred_into(points[b], w, without(points[b], w_cov), angular, mean[b], extra):
            return mean, L, POINTS
        if not semifactor_into(Q[b % Q.shape[0]], L[b]):
            return mean, L, INDEFINITE
        for i in range(n):
            centre[i] = root_centre * extra[i, 0]
            extra[i, 0] = centre[i] if w_cov > 0 else points.dtype.type(0)
            for s in range(1, size):
                extra[i, s] *= root
        tria_into(L[b], extra)
        if w_cov < 0 and not downdate_into(L[b], centre):
            return mean, L, DOWNDATE
    return mean, L, OK


@njit(cache=True, error_model="numpy")
def linearise_into(images, R, w_cov, w, angular, predicted, odd, V, root):  # type: ignore[no-untyped-def]
    """Deviations of the images in two parts, each pair of opposite points rotated by 45 degrees: the odd part (m,
    n), which is the slope times the prior's factor, and the factor V (m, m) of R plus the even part, which is
    what no straight line explains. Together, odd odd^T + V V^T, they are the innovation's covariance, whose factor
    is `root` (eqs 25, 26). A negative centre weight is in `root`, by a downdate, but not in V; a status."""
    m, n = odd.shape
    d, even = np.empty((m, 2 * n + 1), odd.dtype), np.empty((m, n + 1), odd.dtype)
    if not centred_into(images, w, without(images, w_cov), angular, predicted, d):
        return IMAGES
    if not semifactor_into(R, V):
        return INDEFINITE
    share, centre = np.sqrt(odd.dtype.type(0.5) * w), np.sqrt(abs(w_cov))
    column = np.empty(m, odd.dtype)
    for a in range(m):
        column[a] = centre * d[a, 0]
        even[a, n] = column[a] if w_cov > 0 else odd.dtype.type(0)
        for i in range(n):
            odd[a, i] = share * (d[a, 1 + i] - d[a, 1 + n + i])
            even[a, i] = share * (d[a, 1 + i] + d[a, 1 + n + i])
    tria_into(V, even)
    root[:] = V
    tria_into(root, odd.copy())
    if w_cov < 0 and not downdate_into(root, column):
        return DOWNDATE
    return OK if sound(root) else INNOVATION


@njit(cache=True, error_model="numpy")
def gain_into(L, odd, root, innovation, considered, K, U, S):  # type: ignore[no-untyped-def]
    """Gain K (n, m), U = K root (n, m) and S = root root^T (m, m), with the factor L of the prior (eqs 27, 28);
    the NIS."""
    n, m = K.shape
    nis = L.dtype.type(0)
    for a in range(m):
        for b in range(m):
            S[a, b] = 0.0
            for c in range(min(a, b) + 1):
                S[a, b] += root[a, c] * root[b, c]
    white = np.empty(m, L.dtype)
    for a in range(m):
        white[a] = innovation[a]
        for b in range(a):
            white[a] -= root[a, b] * white[b]
        white[a] /= root[a, a]
        nis += white[a] * white[a]
    for i in range(n):
        for a in range(m):  # U = P_xz root^-T, with P_xz = L odd^T
            U[i, a] = 0.0
            if considered[i]:
                continue
            for j in range(i + 1):
                U[i, a] += L[i, j] * odd[a, j]
            for b in range(a):
                U[i, a] -= root[a, b] * U[i, b]
            U[i, a] /= root[a, a]
        for a in range(m - 1, -1, -1):
            K[i, a] = U[i, a]
            for b in range(a + 1, m):
                K[i, a] -= root[b, a] * K[i, b]
            K[i, a] /= root[a, a]
    return nis


@njit(cache=True, error_model="numpy")
def joseph_into(L, slope, K, V, out):  # type: ignore[no-untyped-def]
    """out := tria[L - K slope, K V]: eq 32, transposed as it must be; slope (m, n) is H L, and K V V^T K^T is what
    noise the gain lets in."""
    n, m = K.shape
    extra = np.empty((n, n + m), L.dtype)
    for i in range(n):
        for j in range(n):
            out[i, j] = 0.0
            extra[i, j] = L[i, j] if j <= i else L.dtype.type(0)
            for a in range(m):
                extra[i, j] -= K[i, a] * slope[a, j]
        for c in range(m):
            extra[i, n + c] = 0.0
            for a in range(c, m):
                extra[i, n + c] += K[i, a] * V[a, c]
    tria_into(out, extra)


@njit(signatures(3, 3, 3, 2, 3, "f", "f", FLAGS, FLAGS), cache=True, error_model="numpy")
def correct(points, L, images, y, R, w_cov, w, angular, considered):  # type: ignore[no-untyped-def]
    """Update by triangularisation. (mean, factor, gain K, U = K chol(S), innovation, its covariance, predicted,
    NIS, status), each over the batch; U is what the classical form subtracts from the prior's factor."""
    count, size, n = points.shape
    m = y.shape[1]
    dtype = points.dtype
    mean_out, L_out = np.empty((count, n), dtype), np.empty((count, n, n), dtype)
    K, U = np.empty((count, n, m), dtype), np.empty((count, n, m), dtype)
    innovation, predicted = np.empty((count, m), dtype), np.empty((count, m), dtype)
    S, nis = np.empty((count, m, m), dtype), np.empty(count, dtype)
    fits = images.shape == (count, size, m) and y.shape[0] in (1, count) and L.shape[0] in (1, count)
    fits = fits and R.shape[0] in (1, count) and R.shape[1:] == (m, m)
    status = OK if fits else SHAPE
    odd, V, root = np.empty((m, n), dtype), np.empty((m, m), dtype), np.empty((m, m), dtype)
    for b in range(count):
        if status == OK:
            noise = R[b % R.shape[0]]
            status = linearise_into(images[b], noise, w_cov, w, angular, predicted[b], odd, V, root)
        if status == OK:
            status = innovate_into(y[b % y.shape[0]], predicted[b], angular, innovation[b])
        if status != OK:
            return mean_out, L_out, K, U, innovation, S, predicted, nis, status
        prior = L[b % L.shape[0]]
        nis[b] = gain_into(prior, odd, root, innovation[b], considered, K[b], U[b], S[b])
        for i in range(n):
            mean_out[b, i] = points[b, 0, i]
            for a in range(m):
                mean_out[b, i] += K[b, i, a] * innovation[b, a]
        joseph_into(prior, odd, K[b], V, L_out[b])
    return mean_out, L_out, K, U, innovation, S, predicted, nis, status


@njit(signatures(3, 3, 3, 3), cache=True, error_model="numpy")
def joseph(L, H, K, R):  # type: ignore[no-untyped-def]
    """(tria[(I - K H) L, K S_R] (B, n, n), status): eqs 30-32 with a Jacobian H (B, m, n)."""
    count, n, m = K.shape
    out = np.empty((count, n, n), L.dtype)
    if H.shape != (count, m, n) or L.shape[0] not in (1, count):
        return out, SHAPE
    HL, V = np.empty((m, n), L.dtype), np.empty((m, m), L.dtype)
    for b in range(count):
        prior = L[b % L.shape[0]]
        if not semifactor_into(R[b % R.shape[0]], V):
            return out, INDEFINITE
        for a in range(m):
            for j in range(n):
                HL[a, j] = 0.0
                for i in range(j, n):
                    HL[a, j] += H[b, a, i] * prior[i, j]
        joseph_into(prior, HL, K[b], V, out[b])
        if not sound(out[b]):
            return out, MATRIX
    return out, OK
