"""Compiled arithmetic of the sigma-point filters: plain loops over one filter; `_kernels_transform` and
`_kernels_points` call them.

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
from onboard.filters.compiled import CONTRACTED, FILLING

TWO_PI: Final = 2.0 * np.pi


def _in(dtype: Any, ndim: int) -> Any:
    return types.Array(dtype, ndim, "A", readonly=True)


def signatures(*arguments: Any) -> list[Any]:
    """The signatures for both precisions; an int stands for an array of so many dimensions, "f" for a number,
    "out" for a matrix to write into, "packed" and the dimensions for an array without gaps."""
    made = []
    for dtype in (types.float64, types.float32):
        kinds = {"f": dtype, "out": types.Array(dtype, 2, "C")}
        kinds |= {f"packed {d}": types.Array(dtype, d, "C", readonly=True) for d in (2, 3)}
        made.append(tuple(_in(dtype, a) if isinstance(a, int) else kinds.get(a, a) for a in arguments))
    return made


FLAGS: Final = types.Array(types.boolean, 1, "A", readonly=True)


@njit(**FILLING, **CONTRACTED)
def factor_into(A, lower_t):  # type: ignore[no-untyped-def]
    """Cholesky factor of A (n, n), transposed, into `lower_t` (n, n): row j is column j of the lower factor.
    False if A is not positive definite or not finite. Only A's upper triangle is read."""
    n = A.shape[0]
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= lower_t[k, j] * lower_t[k, j]
        if not (pivot > 0.0 and pivot < np.inf):
            return False
        root = np.sqrt(pivot)
        inverse = root * (1.0 / pivot)  # while the root is being drawn
        lower_t[j, j] = root
        for i in range(j + 1, n):  # sums in registers: half the time of subtracting row from row
            value = A[j, i]
            for k in range(j):
                value -= lower_t[k, i] * lower_t[k, j]
            lower_t[j, i] = value * inverse
            lower_t[i, j] = 0.0
    return True


@njit(**FILLING, **CONTRACTED)
def spread_into(mean, P, gamma, points):  # type: ignore[no-untyped-def]
    """Sigma points of one filter into `points` (2n+1, n); a status."""
    n = mean.shape[0]
    if P.shape[0] != n or P.shape[1] != n or points.shape[0] != 2 * n + 1 or points.shape[1] != n:
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
            points[j, i] = points[0, i] + offset
            points[n + j, i] = points[0, i] - offset
    return OK


@njit(**FILLING, **CONTRACTED)
def squares_into(a, count, out):  # type: ignore[no-untyped-def]
    """The lower triangle of out = a[:, :count] a[:, :count]^T.

    The number of rows must be a multiple of three: nine sums at a time need six loads, where one needs two.
    """
    for i in range(0, a.shape[0], 3):
        u, v, w = a[i, 0], a[i + 1, 0], a[i + 2, 0]
        uu, vu, vv, wu, wv, ww = u * u, v * u, v * v, w * u, w * v, w * w
        for s in range(1, count):
            u, v, w = a[i, s], a[i + 1, s], a[i + 2, s]
            uu += u * u
            vu += v * u
            vv += v * v
            wu += w * u
            wv += w * v
            ww += w * w
        out[i, i] = uu
        out[i + 1, i], out[i + 1, i + 1] = vu, vv
        out[i + 2, i], out[i + 2, i + 1], out[i + 2, i + 2] = wu, wv, ww
        for j in range(0, i, 3):
            u, v, w, x, y, z = a[i, 0], a[i + 1, 0], a[i + 2, 0], a[j, 0], a[j + 1, 0], a[j + 2, 0]
            ux, uy, uz, vx, vy, vz, wx, wy, wz = u * x, u * y, u * z, v * x, v * y, v * z, w * x, w * y, w * z
            for s in range(1, count):
                u, v, w = a[i, s], a[i + 1, s], a[i + 2, s]
                x, y, z = a[j, s], a[j + 1, s], a[j + 2, s]
                ux += u * x
                uy += u * y
                uz += u * z
                vx += v * x
                vy += v * y
                vz += v * z
                wx += w * x
                wy += w * y
                wz += w * z
            out[i, j], out[i, j + 1], out[i, j + 2] = ux, uy, uz
            out[i + 1, j], out[i + 1, j + 1], out[i + 1, j + 2] = vx, vy, vz
            out[i + 2, j], out[i + 2, j + 1], out[i + 2, j + 2] = wx, wy, wz


@njit(**FILLING)
def threes(rows):  # type: ignore[no-untyped-def]
    """`rows`, up to a multiple of three."""
    return (rows + 2) // 3 * 3


@njit((types.int64,), **FILLING)
def gather_room(n):  # type: ignore[no-untyped-def]
    """Shape of the scratch of `gather_into`."""
    return 2 * threes(n), 2 * n + 3


@njit(**FILLING, **CONTRACTED)
def gather_into(points, w_mean, w_cov, w, Q, scratch, mean, P):  # type: ignore[no-untyped-def]
    """Weighted mean and covariance, plus Q, of one filter's points (2n+1, n); a status."""
    k, n = points.shape
    if k != 2 * n + 1 or Q.shape[0] != n or Q.shape[1] != n:
        return SHAPE
    rows = threes(n)
    d, sums = scratch[:rows], scratch[rows:]  # d: one row per component, so that sums run along memory
    others = points[1:]
    minus = others[n:]
    for i in range(n, rows):
        for s in range(k):
            d[i, s] = w - w
    for i in range(n):
        total = w - w
        for s in range(n):
            total += others[s, i] + minus[s, i]
        centre = w * total + w_mean * points[0, i]
        for s in range(k - 1):
            d[i, s] = others[s, i] - centre
        d[i, k - 1] = points[0, i] - centre
        mean[i] = centre
        if not np.isfinite(centre):
            return POINTS
    squares_into(d, k - 1, sums)
    off = w - w  # stays zero as long as all is finite
    half = mean.dtype.type(0.5)
    for i in range(n):
        share, here = w_cov * d[i, k - 1], w - w
        for j in range(i + 1):
            value = w * sums[i, j] + share * d[j, k - 1] + half * (Q[i, j] + Q[j, i])
            here += value - value
            P[i, j] = value
            P[j, i] = value
        off += here
    return OK if off == 0 else NOISE


@njit(**FILLING, **CONTRACTED)
def wrapped(x):  # type: ignore[no-untyped-def]
    """An angle in [-pi, pi]."""
    return x - TWO_PI * np.rint(x * (1.0 / TWO_PI))


@njit(**FILLING, **CONTRACTED)
def deviations_into(images, y, w, angular, d, innovation, predicted):  # type: ignore[no-untyped-def]
    """Deviations of one filter's images (2n+1, m) from their mean `predicted`, and the innovation; a status. In
    d (m, 2n+1): n differences of opposite images, n sums of their deviations, and the centre's deviation."""
    k, m = images.shape
    n = k // 2
    plus, minus = images[1:], images[n + 1 :]
    for a in range(m):  # relative to the centre's image, so that a mean of angles does not break at +-pi
        centre = images[0, a]
        total = w - w
        row, opposite = d[a], d[a, n:]
        for s in range(n):
            one, other = plus[s, a] - centre, minus[s, a] - centre
            if angular[a]:
                one, other = wrapped(one), wrapped(other)
            row[s], opposite[s] = one - other, one + other
            total += one + other
        shift = w * total
        for s in range(n):
            opposite[s] -= shift + shift
        row[k - 1] = -shift
        predicted[a] = centre + shift
        z = y[a] - predicted[a]
        if angular[a]:
            z = wrapped(z)
        innovation[a] = z
        if not np.isfinite(predicted[a]):
            return IMAGES
        if not np.isfinite(z):
            return MEASUREMENT
    return OK


@njit(**FILLING, **CONTRACTED)
def whiten_into(S, innovation, lower, inverse, white):  # type: ignore[no-untyped-def]
    """white (m,) = L^-1 innovation, with L L^T = S (m, m); (whether L exists, NIS). L is left in `lower` (m, m),
    the inverse of its diagonal in `inverse` (m,)."""
    m = S.shape[0]
    nis = S.dtype.type(0)
    for a in range(m):
        value = innovation[a]
        for b in range(a):
            entry = S[b, a]
            for c in range(b):
                entry -= lower[a, c] * lower[b, c]
            entry *= inverse[b]
            lower[a, b] = entry
            value -= entry * white[b]
        pivot = S[a, a]
        for c in range(a):
            pivot -= lower[a, c] * lower[a, c]
        if not (pivot > 0.0 and pivot < np.inf):
            return False, nis
        inverse[a] = 1.0 / np.sqrt(pivot)
        white[a] = value * inverse[a]
        nis += white[a] * white[a]
    return True, nis


@njit(**FILLING, **CONTRACTED)
def offsets_by_into(points, d, m, out):  # type: ignore[no-untyped-def]
    """out (n, m) = the sum over points 1 to n of their offsets from the centre, times those of d (threes(m), n).
    Nine sums at a time, as in `squares_into`."""
    n = points.shape[1]
    plus, whole, zero = points[1 : n + 1], n // 3 * 3, points.dtype.type(0)
    for i in range(0, whole, 3):
        p, q, r = points[0, i], points[0, i + 1], points[0, i + 2]
        for j in range(0, m, 3):
            ux, uy, uz, vx, vy, vz, wx, wy, wz = zero, zero, zero, zero, zero, zero, zero, zero, zero
            for s in range(n):
                u, v, w = plus[s, i] - p, plus[s, i + 1] - q, plus[s, i + 2] - r
                x, y, z = d[j, s], d[j + 1, s], d[j + 2, s]
                ux += u * x
                uy += u * y
                uz += u * z
                vx += v * x
                vy += v * y
                vz += v * z
                wx += w * x
                wy += w * y
                wz += w * z
            out[i, j], out[i, j + 1], out[i, j + 2] = ux, uy, uz
            out[i + 1, j], out[i + 1, j + 1], out[i + 1, j + 2] = vx, vy, vz
            out[i + 2, j], out[i + 2, j + 1], out[i + 2, j + 2] = wx, wy, wz
    for i in range(whole, n):
        for a in range(m):
            total = zero
            for s in range(n):
                total += (plus[s, i] - points[0, i]) * d[a, s]
            out[i, a] = total


@njit((types.int64, types.int64), **FILLING)
def correct_room(n, m):  # type: ignore[no-untyped-def]
    """Shape of the scratch of `correct_into`."""
    return 2 * threes(m) + threes(n) + max(threes(n), m + 2), max(2 * n + 1, threes(m))


@njit(**FILLING, **CONTRACTED)
def correct_into(  # type: ignore[no-untyped-def] # noqa: PLR0912 - loops
    points, images, P, y, R, w_cov, w, angular, considered, scratch, mean_out, P_out, innovation, S, predicted
):
    """Measurement update of one filter from its points (2n+1, n) and their images (2n+1, m); (status, NIS)."""
    k, n = points.shape
    m = y.shape[0]
    zero = points.dtype.type(0)
    if images.shape[0] != k or images.shape[1] != m or R.shape[0] != m or R.shape[1] != m:
        return SHAPE, zero
    few, many = threes(m), threes(n)
    d, sums, rest = scratch[:few], scratch[few : 2 * few], scratch[2 * few :]
    cross, reductions = rest[:many], rest[many:]
    for a in range(m, few):
        for s in range(k):
            d[a, s] = zero
    for i in range(n, many):
        for a in range(m):
            cross[i, a] = zero
    status = deviations_into(images, y, w, angular, d, innovation, predicted)
    if status != OK:
        return status, zero
    squares_into(d, k - 1, sums)
    half = points.dtype.type(0.5)
    for a in range(m):
        for b in range(a + 1):
            noise = half * (w * sums[a, b] + R[a, b] + R[b, a])  # two squares make one of a sum and a difference
            S[a, b] = noise + w_cov * d[a, k - 1] * d[b, k - 1]
            S[b, a] = S[a, b]
    lower, inverse, white = reductions[:m], reductions[m], reductions[m + 1]  # where the sums come later
    exists, nis = whiten_into(S, innovation, lower, inverse, white)  # a chain of roots, while the rest goes on
    if not exists:
        return INNOVATION, zero
    offsets_by_into(points, d, m, cross)  # the set is symmetric: differences of opposite images are enough
    loose = False  # whether any pair of states is moved as usual, and which are not
    for i in range(n):
        step = zero
        for a in range(m):  # cross = cross w L^-T
            entry = w * cross[i, a]
            for b in range(a):
                entry -= lower[a, b] * cross[i, b]
            entry *= inverse[a]
            cross[i, a] = entry
            step += entry * white[a]
        loose |= considered[i]
        mean_out[i] = points[0, i] + (zero if considered[i] else step)
    if m > 0:
        squares_into(cross, m, reductions)  # K S K^T
    else:
        reductions[:] = zero
    if loose:
        for i in range(n):
            for j in range(i + 1):
                if considered[i] and considered[j]:
                    reductions[i, j] = zero
    for i in range(n):
        for j in range(i + 1):
            value = P[j, i] - reductions[i, j]
            P_out[i, j] = value
            P_out[j, i] = value
    return OK, nis
