"""Compiled arithmetic of the square-root filters: sigma points from a factor, and the updates made of
triangularisations.

Precision, batches and cache as in `_kernels_factor`.
"""

import numpy as np
from numba import njit

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
    POSTERIOR,
    PREDICTED,
    SHAPE,
)
from onboard.filters.compiled import FILLING
from onboard.filters.kernels.factors import downdate_into, sound, tria_into
from onboard.filters.kernels.linear import common, innovate_into, semifactor_into
from onboard.filters.kernels.linearisation import centred_into, without
from onboard.filters.kernels.sigma_points import FLAGS, signatures


@njit(**FILLING)
def spread_into(mean, lower, gamma, points):  # type: ignore[no-untyped-def]
    """Sigma points of one filter into `points` (2n+1, n); a status."""
    n = mean.shape[0]
    if not sound(lower):
        return FACTOR
    for i in range(n):
        if not np.isfinite(mean[i]):
            return MEAN
        points[0, i] = mean[i]
        for j in range(n):
            offset = gamma * lower[i, j] if j <= i else mean.dtype.type(0)
            points[1 + j, i] = points[0, i] + offset
            points[1 + n + j, i] = points[0, i] - offset
    return OK


@njit(signatures(2, 3, "f"), cache=True, error_model="numpy")
def spread(mean, L, gamma):  # type: ignore[no-untyped-def]
    """(points (B, 2n+1, n), status) from a mean and the factor of its covariance (only the lower triangle)."""
    count, n = common((mean.shape[0], L.shape[0])), mean.shape[1]
    points = np.empty((max(count, 0), 2 * n + 1, n), mean.dtype)
    if count < 0 or L.shape[1:] != (n, n):
        return points, SHAPE
    for b in range(count):
        status = spread_into(mean[b % mean.shape[0]], L[b % L.shape[0]], gamma, points[b])
        if status != OK:
            return points, status
    return points, OK


@njit(**FILLING)
def gather_into(points, Q, w_cov, w, plain, extra, centre, mean, L):  # type: ignore[no-untyped-def]
    """Mean (n,) and factor (n, n) of one filter's points (2n+1, n) plus noise (eqs 20-22), with scratch `extra`
    (n, 2n+1) and `centre` (n,), and `plain` (n,) to say that no state is an angle; a status."""
    size, n = points.shape
    if Q.shape != (n, n) or size != 2 * n + 1:
        return SHAPE
    root, root_centre = np.sqrt(w), np.sqrt(abs(w_cov))
    if not centred_into(points, w, without(points, w_cov), plain, mean, extra):
        return POINTS
    if not semifactor_into(Q, L):
        return INDEFINITE
    for i in range(n):
        centre[i] = root_centre * extra[i, 0]
        extra[i, 0] = centre[i] if w_cov > 0 else points.dtype.type(0)
        for s in range(1, size):
            extra[i, s] *= root
    tria_into(L, extra)
    return OK if w_cov >= 0 or downdate_into(L, centre) else DOWNDATE


@njit(signatures(3, 3, "f", "f"), cache=True, error_model="numpy")
def gather(points, Q, w_cov, w):  # type: ignore[no-untyped-def]
    """(mean (B, n), factor (B, n, n), status) of points (B, 2n+1, n) plus noise Q."""
    count, _, n = points.shape
    mean, L = np.empty((count, n), points.dtype), np.empty((count, n, n), points.dtype)
    if Q.shape[0] not in (1, count):
        return mean, L, SHAPE
    extra, centre = np.empty((n, 2 * n + 1), points.dtype), np.empty(n, points.dtype)
    plain = np.zeros(n, np.bool_)
    for b in range(count):
        status = gather_into(points[b], Q[b % Q.shape[0]], w_cov, w, plain, extra, centre, mean[b], L[b])
        if status != OK:
            return mean, L, status
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
    noise the gain lets in. `out` may be L."""
    n, m = K.shape
    extra = np.empty((n, n + m), L.dtype)
    for i in range(n):
        for j in range(n):
            extra[i, j] = L[i, j] if j <= i else L.dtype.type(0)
            out[i, j] = 0.0
            for a in range(m):
                extra[i, j] -= K[i, a] * slope[a, j]
        for c in range(m):
            extra[i, n + c] = 0.0
            for a in range(c, m):
                extra[i, n + c] += K[i, a] * V[a, c]
    tria_into(out, extra)


@njit(cache=True, error_model="numpy")
def correct_into(  # type: ignore[no-untyped-def]
    points,
    L,
    images,
    y,
    R,
    w_cov,
    w,
    angular,
    considered,
    odd,
    V,
    root,
    mean_out,
    L_out,
    K,
    U,
    innovation,
    S,
    predicted,
):
    """Update of one filter by triangularisation; (status, NIS). `odd`, `V` and `root` as in `linearise_into`."""
    status = linearise_into(images, R, w_cov, w, angular, predicted, odd, V, root)
    if status == OK:
        status = innovate_into(y, predicted, angular, innovation)
    if status != OK:
        return status, points.dtype.type(0)
    nis = gain_into(L, odd, root, innovation, considered, K, U, S)
    for i in range(K.shape[0]):
        mean_out[i] = points[0, i]
        for a in range(K.shape[1]):
            mean_out[i] += K[i, a] * innovation[a]
    joseph_into(L, odd, K, V, L_out)
    return OK, nis


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
                odd,
                V,
                root,
                mean_out[b],
                L_out[b],
                K[b],
                U[b],
                innovation[b],
                S[b],
                predicted[b],
            )
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


# ------------------------------------------------------------------- one filter, a step at a time (`stepping`)


@njit(signatures(2, 1, 2, "out"), cache=True, error_model="numpy")
def redraw(moved, weights, Q, room):  # type: ignore[no-untyped-def]
    """Mean and factor of the moved points, and new points of them: into the rows of `room` (2n+1 + n, n) the
    points, of which the first is the mean, and the factor; a status. `weights` (4,) as in `Weights`."""
    n = room.shape[1]
    points, L = room[: 2 * n + 1], room[2 * n + 1 :]
    extra, centre = np.empty((n, 2 * n + 1), room.dtype), np.empty(n, room.dtype)
    status = gather_into(moved, Q, weights[2], weights[3], np.zeros(n, np.bool_), extra, centre, points[0], L)
    if status == OK:
        status = spread_into(points[0], L, weights[0], points)
    return PREDICTED if status == FACTOR else status


@njit(signatures("out", 2, 1, 2, 1, FLAGS), cache=True, error_model="numpy")
def correct_and_redraw(room, images, y, R, weights, marks):  # type: ignore[no-untyped-def]
    """Update in place of `room`, as `redraw` gives it; `marks` (m + n,) are those of angular components and of
    considered states. (status, NIS)."""
    n, m = room.shape[1], y.shape[0]
    points, L = room[: 2 * n + 1], room[2 * n + 1 :]
    if marks.shape[0] != m + n or images.shape != (2 * n + 1, m) or R.shape != (m, m):
        return SHAPE, room.dtype.type(0)
    scratch = np.empty((4 * m + 2 * n + 2, max(m, n)), room.dtype)
    odd, V, root, S = (
        scratch[:m, :n],
        scratch[m : 2 * m, :m],
        scratch[2 * m : 3 * m, :m],
        scratch[3 * m : 4 * m, :m],
    )
    K, U = scratch[4 * m : 4 * m + n, :m], scratch[4 * m + n : 4 * m + 2 * n, :m]
    told = scratch[4 * m + 2 * n :, :m]
    status, nis = correct_into(
        points,
        L,
        images,
        y,
        R,
        weights[2],
        weights[3],
        marks[:m],
        marks[m:],
        odd,
        V,
        root,
        points[0],
        L,
        K,
        U,
        told[0],
        S,
        told[1],
    )
    if status == OK:
        status = spread_into(points[0], L, weights[0], points)
    return POSTERIOR if status == FACTOR else status, nis
