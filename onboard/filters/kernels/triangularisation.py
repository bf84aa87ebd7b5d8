"""Compiled arithmetic of the square-root filters, over one filter, for `square_root`."""

from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FILLING, MAKING, kernel
from onboard.filters.errors import (
    DOWNDATE_ERROR,
    FACTOR_ERROR,
    INNOVATION_ERROR,
    MEAN_ERROR,
    OK,
    POINTS_ERROR,
    Q_INDEFINITE_ERROR,
    R_INDEFINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import semifactor_into
from onboard.filters.kernels.factors import downdate_into, is_factor, tria_into
from onboard.filters.kernels.images import centred_into, skips_centre
from onboard.filters.kernels.linear import innovate_into


@kernel(**FILLING)
def spread_into(mean, lower, gamma, points):
    """Fill the sigma points of one filter into `points` (2n+1, n); return a status."""
    n = mean.shape[0]
    if not is_factor(lower, 0.0):
        return FACTOR_ERROR
    for i in range(n):
        if not np.isfinite(mean[i]):
            return MEAN_ERROR
        points[0, i] = mean[i]
        for j in range(n):
            offset = gamma * lower[i, j] if j <= i else 0.0
            points[1 + j, i] = points[0, i] + offset
            points[1 + n + j, i] = points[0, i] - offset
    return OK


@kernel(**FILLING)
def gather_into(points, Q, w_cov, w, no_angles, extra, centre, mean, L):
    """Fill mean (n,) and factor (n, n) of one filter's points (2n+1, n) plus noise (eqs 20-22); return a status.

    The scratch is `extra` (n, 2n+1) and `centre` (n,); the mask `no_angles` (n,) is all False.
    """
    size, n = points.shape
    if Q.shape != (n, n) or size != 2 * n + 1:
        return SHAPE_ERROR
    root, root_centre = np.sqrt(w), np.sqrt(abs(w_cov))
    if centred_into(points, w, skips_centre(points, w_cov), no_angles, mean, extra) != OK:
        return POINTS_ERROR
    if not semifactor_into(Q, L):
        return Q_INDEFINITE_ERROR
    for i in range(n):
        centre[i] = root_centre * extra[i, 0]
        extra[i, 0] = centre[i] if w_cov > 0 else 0.0
        for s in range(1, size):
            extra[i, s] *= root
    tria_into(L, extra)
    return OK if w_cov >= 0 or downdate_into(L, centre) else DOWNDATE_ERROR


@kernel(**MAKING)
def linearise_into(images, R, w_cov, w, angular, predicted, odd, V, root):
    """Fill the deviations of the images in two parts, with pairs of opposite points rotated by 45 degrees.

    They are the odd part (m, n), which is the slope times the prior's factor, and the factor V (m, m) of R plus
    the even part, which no straight line explains. Their sum odd odd^T + V V^T is the innovation's covariance, and
    `root` its factor (eqs 25, 26). A negative centre weight is in `root`, by a downdate, but not in V. Returns a
    status.
    """
    m, n = odd.shape
    d, even = np.empty((m, 2 * n + 1)), np.empty((m, n + 1))
    status = centred_into(images, w, skips_centre(images, w_cov), angular, predicted, d)
    if status != OK:
        return status
    if not semifactor_into(R, V):
        return R_INDEFINITE_ERROR
    share, centre = np.sqrt(0.5 * w), np.sqrt(abs(w_cov))
    column = np.empty(m)
    for a in range(m):
        column[a] = centre * d[a, 0]
        even[a, n] = column[a] if w_cov > 0 else 0.0
        for i in range(n):
            odd[a, i] = share * (d[a, 1 + i] - d[a, 1 + n + i])
            even[a, i] = share * (d[a, 1 + i] + d[a, 1 + n + i])
    tria_into(V, even)
    root[:] = V
    tria_into(root, odd.copy())
    if w_cov < 0 and not downdate_into(root, column):
        return DOWNDATE_ERROR
    return OK if is_factor(root, np.finfo(np.float64).tiny) else INNOVATION_ERROR


@kernel(**MAKING)
def gain_into(L, odd, root, innovation, considered, K, U, S):
    """Fill gain K (n, m), U = K root (n, m) and S = root root^T (m, m), with the prior's factor L; return the NIS.

    Eqs 27, 28.
    """
    n, m = K.shape
    nis = 0.0
    for a in range(m):
        for b in range(m):
            S[a, b] = 0.0
            for c in range(min(a, b) + 1):
                S[a, b] += root[a, c] * root[b, c]
    white = np.empty(m)
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


@kernel(**MAKING)
def joseph_into(L, slope, K, V, out):
    """Fill out with tria[L - K slope, K V]: eq 32, transposed as it must be.

    The slope (m, n) is H L; K V V^T K^T is the noise that the gain admits. `out` may be L.
    """
    n, m = K.shape
    extra = np.empty((n, n + m))
    for i in range(n):
        for j in range(n):
            extra[i, j] = L[i, j] if j <= i else 0.0
            out[i, j] = 0.0
            for a in range(m):
                extra[i, j] -= K[i, a] * slope[a, j]
        for c in range(m):
            extra[i, n + c] = 0.0
            for a in range(c, m):
                extra[i, n + c] += K[i, a] * V[a, c]
    tria_into(out, extra)


class Linearised(NamedTuple):
    """Outputs of `linearise_into`: `odd` (m, n), and the factors `V` and `root` (m, m)."""

    odd: Array
    V: Array
    root: Array


class CorrectedFactor(NamedTuple):
    """Outputs of `correct_into`.

    They are mean (n,) and factor (n, n), gain K (n, m) and U = K chol(S) (n, m), innovation (m,) and its
    covariance (m, m), and the predicted measurement (m,).
    """

    mean: Array
    factor: Array
    K: Array
    U: Array
    innovation: Array
    S: Array
    predicted: Array


@kernel(**MAKING)
def correct_into(points, L, images, y, R, w_cov, w, angular, considered, scratch, out):
    """Update one filter by triangularisation into `out`, with scratch `Linearised`; return (status, NIS)."""
    odd, V, root = scratch
    mean_out, L_out, K, U, innovation, S, predicted = out
    status = linearise_into(images, R, w_cov, w, angular, predicted, odd, V, root)
    if status == OK:
        status = innovate_into(y, predicted, angular, innovation)
    if status != OK:
        return status, 0.0
    nis = gain_into(L, odd, root, innovation, considered, K, U, S)
    for i in range(K.shape[0]):
        mean_out[i] = points[0, i]
        for a in range(K.shape[1]):
            mean_out[i] += K[i, a] * innovation[a]
    joseph_into(L, odd, K, V, L_out)
    return OK, nis
