"""Compiled arithmetic of triangular factors: triangularisation, rank-one downdates, squares.

Batches as in `linear`.
"""

import numpy as np

from onboard.compiled import FILLING, MAKING, kernel, signature
from onboard.filters.errors import COVARIANCE_ERROR, DOWNDATE_ERROR, MEMBER_FACTOR, OK, SHAPE_ERROR
from onboard.filters.kernels.cholesky import root_into


@kernel(**FILLING)
def tria_into(lower, extra):
    """Fill `lower` with the lower-triangular S for which S S^T = lower lower^T + extra extra^T.

    S has no negative diagonal; Householder reflections from the right. lower (n, n) must be so already; extra (n,
    k) is overwritten. With p the pivot, e its row of `extra` and a = |(p, e)|, the reflection sends (p, e) to (a,
    0); written out, no step subtracts nearly equal numbers.
    """
    n, k = extra.shape
    for j in range(n):
        p = lower[j, j]
        total = p * p
        for c in range(k):
            total += extra[j, c] * extra[j, c]
        if total == 0:
            continue
        a = np.sqrt(total)
        inverse, share = 1.0 / a, 1.0 / (p + a)
        lower[j, j] = a
        for i in range(j + 1, n):
            dot = 0.0
            for c in range(k):
                dot += extra[i, c] * extra[j, c]
            old = lower[i, j]
            lower[i, j] = (p * old + dot) * inverse
            step = (old + dot * share) * inverse
            for c in range(k):
                extra[i, c] -= step * extra[j, c]


@kernel(**FILLING)
def downdate_into(lower, x):
    """Fill `lower` with the factor of lower lower^T - x x^T (rank one; x (n,) is overwritten).

    Returns False if that is not positive definite, except for states that are and remain known exactly.
    """
    n = lower.shape[0]
    for j in range(n):
        if lower[j, j] == 0 and x[j] == 0:
            continue
        square = (lower[j, j] - x[j]) * (lower[j, j] + x[j])
        if not (square > 0 and square < np.inf):
            return False
        root = np.sqrt(square)
        c, s = root / lower[j, j], x[j] / lower[j, j]
        lower[j, j] = root
        for i in range(j + 1, n):
            lower[i, j] = (lower[i, j] - s * x[i]) / c
            x[i] = c * x[i] - s * lower[i, j]
    return True


@kernel(**FILLING)
def is_factor(lower, least):
    """Return whether a factor is finite, with a diagonal of at least `least`.

    `least` is zero or the smallest positive number.
    """
    good = True
    for i in range(lower.shape[0]):
        good &= lower[i, i] >= least
        for j in range(i + 1):
            good &= np.isfinite(lower[i, j])
    return good


@kernel(signature(3), **MAKING)
def square(L):
    """Return (L L^T (B, n, n), symmetric to the last bit, OK)."""
    count, n = L.shape[0], L.shape[1]
    out = np.zeros((count, n, n))
    for b in range(count):
        for i in range(n):
            for j in range(i + 1):
                for k in range(j + 1):
                    out[b, i, j] += L[b, i, k] * L[b, j, k]
                out[b, j, i] = out[b, i, j]
    return out, OK


@kernel(signature(3), **MAKING)
def factor(P):
    """Return (lower Cholesky factors (B, n, n), status)."""
    count, n = P.shape[0], P.shape[1]
    out, lower_t = np.empty((count, n, n)), np.empty((n, n))
    if P.shape[2] != n:
        return out, SHAPE_ERROR
    for b in range(count):
        if not root_into(P[b], lower_t):
            return out, COVARIANCE_ERROR + MEMBER_FACTOR * b
        out[b] = lower_t.T
    return out, OK


@kernel(signature(3, 3), **MAKING)
def downdate(L, U):
    """Return (the factor of L L^T - U U^T (B, n, n), status).

    There is a rank-one downdate for each column of U (B, n, m).
    """
    count, n, m = U.shape
    out, x = np.empty((count, n, n)), np.empty(n)
    if L.shape[0] not in (1, count):
        return out, SHAPE_ERROR
    for b in range(count):
        for i in range(n):
            for j in range(n):
                out[b, i, j] = L[b % L.shape[0], i, j] if j <= i else 0.0
        for a in range(m):
            for i in range(n):
                x[i] = U[b, i, a]
            if not downdate_into(out[b], x):
                return out, DOWNDATE_ERROR + MEMBER_FACTOR * b
    return out, OK
