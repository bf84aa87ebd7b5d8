"""Compiled arithmetic of the smooth variable structure filters: gains, and covariances after them.

L_t (n, n) is the prior's factor, transposed, and B (n, m) the whitened cross-covariance, as in
`variable_structure`: H = B^T L^-1. Gains and inverses are kept transposed too, one row for each measured quantity.
Every product here is then a sum of rows, which are contiguous in memory.
"""

import numpy as np

from onboard.compiled import CONTRACTED, FILLING, MAKING, kernel
from onboard.filters.kernels.cholesky import factor_into


@kernel(**FILLING, **CONTRACTED)
def add_transposed_product_into(A, C, out):
    """Add A^T C to out (n, m), of A (k, n) and C (k, m)."""
    for i in range(out.shape[0]):
        for c in range(A.shape[0]):
            entry = A[c, i]
            for j in range(out.shape[1]):
                out[i, j] += entry * C[c, j]


@kernel(**MAKING)
def solve_into(lower_t, x):
    """Replace columns x (m, k) by A^-1 x, for A's factor (m, m) from `factor_into`."""
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


@kernel(**MAKING)
def whitened_inverse(B):
    """Return B^+ (m, n).

    Columns have length one in between, so that units do not decide which singular values count as zero.
    """
    n, m = B.shape
    scaled, size = np.empty((m, n)), np.empty(m)
    for a in range(m):
        total = 0.0
        for j in range(n):
            total += B[j, a] * B[j, a]
        size[a] = np.sqrt(total) if total > 0 else 1
        for j in range(n):
            scaled[a, j] = B[j, a] / size[a]
    U_t = independent_inverse(scaled)
    if U_t.shape[0] == 0:
        U_t = np.linalg.pinv(scaled.T.copy(), tolerance(B))
    for a in range(m):
        for j in range(n):
            U_t[a, j] /= size[a]
    return U_t


@kernel(**MAKING)
def independent_inverse(A):
    """Return (A A^T)^-1 A (m, n) of rows A (m, n) of length one, in a tenth of the pseudo-inverse's time.

    Returns (0, 0) if some row is nearly a combination of the others, where the product would lose digits.
    """
    m = A.shape[0]
    product, lower_t = np.dot(A, A.T), np.empty((m, m))
    if not factor_into(product, lower_t):
        return np.empty((0, 0))
    for a in range(m):
        if lower_t[a, a] < 0.1:
            return np.empty((0, 0))
    found = A.copy()
    solve_into(lower_t, found)
    return found


@kernel(**MAKING)
def tolerance(B):
    """Return the singular value that counts as zero, relative to the largest."""
    return 10 * max(B.shape) * np.finfo(np.float64).eps


@kernel(**MAKING)
def widen_into(L_t, B, N, extra, wider):
    """Widen the prior in measured quantities by variances `extra` (m,): L_t and B in place, S into `wider`.

    Returns False without a factor. P + G D G^T with G the weighted right inverse L U, U = (B^T)^+, adds D to H P
    H^T and keeps the correlations of unmeasured states. With M M^T = I + U D U^T that is the factor L M, and B
    becomes M^T B.
    """
    n, m = B.shape
    U_t = whitened_inverse(B)
    inner, M_t, DU_t = np.eye(n), np.empty((n, n)), np.empty((m, n))
    for a in range(m):
        for i in range(n):
            DU_t[a, i] = extra[a] * U_t[a, i]
    add_transposed_product_into(DU_t, U_t, inner)
    if not factor_into(inner, M_t):
        return False
    L_t[:] = np.dot(M_t, L_t)
    B[:] = np.dot(M_t, B)
    wider[:] = N
    add_transposed_product_into(B, B, wider)
    return True


@kernel(**MAKING)
def right_inverse(L_t, B, weighted):
    """Return G^T (m, n) with H G = I (for m > n a left inverse).

    `weighted`: P H^T (H P H^T)^-1, which moves unmeasured states by their correlation; else the paper's H^+, which
    leaves everything orthogonal to H's rows.
    """
    n, m = B.shape
    if weighted:
        G_t = np.zeros((m, n))
        add_transposed_product_into(whitened_inverse(B).T, L_t, G_t)
        return G_t
    H_t = B.copy()  # L^-T B, backwards
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            for a in range(m):
                H_t[j, a] -= L_t[j, i] * H_t[i, a]
        for a in range(m):  # what is known exactly is not moved
            H_t[j, a] = H_t[j, a] / L_t[j, j] if L_t[j, j] > 0 else 0
    return np.linalg.pinv(H_t, tolerance(B))


@kernel(**MAKING)
def kalman_gain(L_t, B, S, ignored):
    """Return K^T (m, n) and (H K)^T (m, m) without the `ignored` components; False without S's factor."""
    n, m = B.shape
    kept, X = S.copy(), B.T.copy()
    for a in range(m):
        if ignored[a]:
            for b in range(m):
                kept[a, b] = kept[b, a] = 0
            kept[a, a] = 1
            X[a] = 0
    lower_t = np.empty((m, m))
    K_t, HK_t = np.zeros((m, n)), np.zeros((m, m))
    if not factor_into(kept, lower_t):
        return K_t, HK_t, False
    solve_into(lower_t, X)
    add_transposed_product_into(X.T, L_t, K_t)
    add_transposed_product_into(X.T, B, HK_t)
    return K_t, HK_t, True


@kernel(**MAKING)
def mixed_gain(L_t, B, S, e, s, ratio, switched, ignored, weighted):
    """Return the gain, transposed (m, n), and the mean's step (n,); False if S has no factor.

    It is Kalman's, but with steps s of the quantities that are `switched`. A measured quantity's own step is a row
    of H K e, or of s: x + K e + G (s - H K e) on the switched rows, and the same with gains for the covariance.
    """
    n, m = B.shape
    step = np.zeros(n)
    if switched.all():
        K_t, HK_t, exists = np.zeros((m, n)), np.zeros((m, m)), True
    else:
        K_t, HK_t, exists = kalman_gain(L_t, B, S, ignored)
    for a in range(m):
        for i in range(n):
            step[i] += K_t[a, i] * e[a]
    if switched.any() and exists:
        G_t = right_inverse(L_t, B, weighted)
        for a in range(m):
            if switched[a]:
                ahead = s[a]
                for b in range(m):
                    ahead -= HK_t[b, a] * e[b]
                    for i in range(n):
                        K_t[b, i] -= G_t[a, i] * HK_t[b, a]
                for i in range(n):
                    step[i] += G_t[a, i] * ahead
                    K_t[a, i] += G_t[a, i] * ratio[a]
    return K_t, step, exists


@kernel(**MAKING)
def joseph_into(L_t, B, N, K_t, P):
    """Fill the covariance after an update with any gain, (L - K B^T)(L - K B^T)^T + K N K^T.

    It is symmetric and positive.
    """
    n, m = B.shape
    left_t, NK_t = L_t.copy(), np.zeros((m, n))
    add_transposed_product_into(-B.T.copy(), K_t, left_t)
    add_transposed_product_into(N, K_t, NK_t)
    P[:] = 0
    add_transposed_product_into(left_t, left_t, P)
    add_transposed_product_into(NK_t, K_t, P)
    for i in range(n):
        for j in range(i):
            P[i, j] = P[j, i]
