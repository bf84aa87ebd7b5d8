"""Compiled arithmetic of the smooth variable structure filters: gains, and what they make of a covariance.

L_t (n, n) is the prior's factor, transposed, and B (n, m) the whitened cross-covariance, as in `_kernels_smooth`:
H = B^T L^-1.
"""

import numpy as np
from numba import njit

from onboard.filters._kernels import factor_into


@njit(cache=True, error_model="numpy")
def solve_into(lower_t, x):  # type: ignore[no-untyped-def]
    """A^-1 x in place, for A's factor (m, m) from `factor_into` and columns x (m, k)."""
    m, k = x.shape
    for a in range(m):
        for b in range(a):
            for i in range(k):
                x[a, i] -= lower_t[b, a] * x[b, i]
        for i in range(k):
            x[a, i] /= lower_t[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            for i in range(k):
                x[a, i] -= lower_t[a, b] * x[b, i]
        for i in range(k):
            x[a, i] /= lower_t[a, a]


@njit(cache=True, error_model="numpy")
def whitened_inverse(B):  # type: ignore[no-untyped-def]
    """(B^T)^+ (n, m), with rows of length one in between, so that units do not decide what counts as zero."""
    n, m = B.shape
    scaled, size = np.empty((m, n), B.dtype), np.empty(m, B.dtype)
    for a in range(m):
        total = 0.0
        for j in range(n):
            total += B[j, a] * B[j, a]
        size[a] = np.sqrt(total) if total > 0 else 1
        for j in range(n):
            scaled[a, j] = B[j, a] / size[a]
    white = independent_inverse(scaled)
    if white.shape[0] == 0:
        white = np.linalg.pinv(scaled, tiny_of(B))
    for j in range(n):
        for a in range(m):
            white[j, a] /= size[a]
    return white


@njit(cache=True, error_model="numpy")
def independent_inverse(A):  # type: ignore[no-untyped-def]
    """A^T (A A^T)^-1 (n, m) of rows A (m, n) of length one, in a tenth of the pseudo-inverse's time; (0, 0) if
    some row comes near a combination of the others, where the product would lose digits."""
    m = A.shape[0]
    product, lower_t = np.dot(A, A.T), np.empty((m, m), A.dtype)
    if not factor_into(product, lower_t):
        return np.empty((0, 0), A.dtype)
    for a in range(m):
        if lower_t[a, a] < 0.1:
            return np.empty((0, 0), A.dtype)
    columns = A.copy()
    solve_into(lower_t, columns)
    return columns.T.copy()


@njit(cache=True, error_model="numpy")
def tiny_of(B):  # type: ignore[no-untyped-def]
    """Relative to the largest, the singular value that counts as zero."""
    return 10 * max(B.shape) * np.finfo(B.dtype).eps


@njit(cache=True, error_model="numpy")
def widen_into(L_t, B, N, extra, wider):  # type: ignore[no-untyped-def]
    """Make the prior wider in measured quantities, by variances `extra` (m,): L_t and B in place, S into `wider`;
    False without a factor.

    P + G D G^T with G the weighted right inverse L U, U = (B^T)^+, adds D to H P H^T and correlates what is not
    measured as it was. With M M^T = I + U D U^T that is the factor L M, and B becomes M^T B.
    """
    n, m = B.shape
    U = whitened_inverse(B)
    inner, M_t = np.empty((n, n), B.dtype), np.empty((n, n), B.dtype)
    for i in range(n):
        for j in range(i, n):
            total = 1.0 if i == j else 0.0
            for a in range(m):
                total += U[i, a] * extra[a] * U[j, a]
            inner[i, j] = inner[j, i] = total
    if not factor_into(inner, M_t):
        return False
    L_t[:] = np.dot(M_t, L_t)
    B[:] = np.dot(M_t, B)
    for a in range(m):
        for b in range(a, m):
            total = N[a, b]
            for j in range(n):
                total += B[j, a] * B[j, b]
            wider[a, b] = wider[b, a] = total
    return True


@njit(cache=True, error_model="numpy")
def right_inverse(L_t, B, weighted):  # type: ignore[no-untyped-def]
    """G (n, m) with H G = I (for m > n a left inverse). `weighted`: P H^T (H P H^T)^-1, which moves states that
    are not measured by their correlation; else the paper's H^+, which leaves what is orthogonal to H's rows."""
    n, m = B.shape
    if weighted:
        white = whitened_inverse(B)
        G = np.zeros((n, m), B.dtype)
        for j in range(n):
            for i in range(j, n):
                for a in range(m):
                    G[i, a] += L_t[j, i] * white[j, a]
        return G
    H_t = B.copy()  # L^-T B, backwards
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            for a in range(m):
                H_t[j, a] -= L_t[j, i] * H_t[i, a]
        for a in range(m):
            H_t[j, a] /= L_t[j, j]
    return np.linalg.pinv(H_t.T.copy(), tiny_of(B))


@njit(cache=True, error_model="numpy")
def kalman_gain(L_t, B, S, ignored):  # type: ignore[no-untyped-def]
    """Gain (n, m) and H K (m, m) as if the `ignored` components were not measured; False without S's factor."""
    n, m = B.shape
    kept, X = S.copy(), B.T.copy()
    for a in range(m):
        if ignored[a]:
            for b in range(m):
                kept[a, b] = kept[b, a] = 0
            kept[a, a] = 1
            X[a] = 0
    lower_t = np.empty((m, m), B.dtype)
    gain, HK = np.zeros((n, m), B.dtype), np.zeros((m, m), B.dtype)
    if not factor_into(kept, lower_t):
        return gain, HK, False
    solve_into(lower_t, X)
    for a in range(m):
        for j in range(n):
            for i in range(j, n):
                gain[i, a] += L_t[j, i] * X[a, j]
            for b in range(m):
                HK[b, a] += B[j, b] * X[a, j]
    return gain, HK, True


@njit(cache=True, error_model="numpy")
def mixed(L_t, B, S, e, s, ratio, switched, ignored, weighted):  # type: ignore[no-untyped-def]
    """Gain (n, m) and step (n,) of the mean: Kalman's, but with steps s of those quantities that are `switched`.

    A measured quantity's own step is a row of H K e, or of s: x + K e + G (s - H K e) on the switched rows, and
    the same with gains for the covariance.
    """
    n, m = B.shape
    step = np.zeros(n, B.dtype)
    if switched.all():
        gain, HK, fine = np.zeros((n, m), B.dtype), np.zeros((m, m), B.dtype), True
    else:
        gain, HK, fine = kalman_gain(L_t, B, S, ignored)
    for i in range(n):
        for a in range(m):
            step[i] += gain[i, a] * e[a]
    if switched.any() and fine:
        G = right_inverse(L_t, B, weighted)
        for a in range(m):
            if switched[a]:
                ahead = s[a]
                for b in range(m):
                    ahead -= HK[a, b] * e[b]
                for i in range(n):
                    step[i] += G[i, a] * ahead
                    gain[i, a] += G[i, a] * ratio[a]
                    for b in range(m):
                        gain[i, b] -= G[i, a] * HK[a, b]
    return gain, step, fine


@njit(cache=True, error_model="numpy")
def joseph_into(L_t, B, N, gain, P):  # type: ignore[no-untyped-def]
    """Covariance after an update with any gain: (L - K B^T)(L - K B^T)^T + K N K^T, symmetric and positive."""
    n, m = B.shape
    left, right = np.empty((n, n), B.dtype), np.zeros((n, m), B.dtype)
    for i in range(n):
        for j in range(n):
            left[i, j] = L_t[j, i] if j <= i else 0
            for a in range(m):
                left[i, j] -= gain[i, a] * B[j, a]
        for a in range(m):
            for b in range(m):
                right[i, a] += gain[i, b] * N[b, a]
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for c in range(n):
                total += left[i, c] * left[j, c]
            for a in range(m):
                total += right[i, a] * gain[j, a]
            P[i, j] = P[j, i] = total
