"""Compiled arithmetic of the sigma-point filters over one filter, for `unscented` and `unscented_transform`.

Sigma-point sets are symmetric, and all weights but the centre's are equal, so three numbers describe the weights.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import CONTRACTED, FILLING, INT, kernel
from onboard.filters.errors import (
    ANGLE_ERROR,
    COVARIANCE_ERROR,
    IMAGES_ERROR,
    INNOVATION_ERROR,
    MAX_ANGLE_SPREAD,
    MEAN_ERROR,
    MEASUREMENT_ERROR,
    OK,
    POINTS_ERROR,
    POSTERIOR_ERROR,
    Q_NOT_FINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import clear_known, factor_into, transposed_semifactor_into
from onboard.filters.kernels.products import offsets_by_into, padded, squares_into

TWO_PI: Final = 2.0 * np.pi
MIN_VARIANCE_FACTOR: Final = (
    8.0  # times the root of the type's epsilon; a smaller remaining variance has few digits
)


@kernel(**FILLING, **CONTRACTED)
def spread_into(mean, P, gamma, points):
    """Fill the sigma points of one filter into `points` (2n+1, n); return a status."""
    n = mean.shape[0]
    if P.shape[0] != n or P.shape[1] != n or points.shape[0] != 2 * n + 1 or points.shape[1] != n:
        return SHAPE_ERROR
    for i in range(n):
        if not np.isfinite(mean[i]):
            return MEAN_ERROR
        points[0, i] = mean[i]
    if not factor_into(P, points[1 : n + 1]) and not transposed_semifactor_into(P, points[1 : n + 1]):
        return COVARIANCE_ERROR
    for j in range(1, n + 1):
        for i in range(n):
            offset = gamma * points[j, i]
            points[j, i] = points[0, i] + offset
            points[n + j, i] = points[0, i] - offset
    return OK


@kernel((INT,), **FILLING)
def gather_scratch_shape(n):
    """Return the shape of the scratch of `gather_into`."""
    return 2 * padded(n), 2 * n + 3


@kernel(**FILLING, **CONTRACTED)
def gather_into(points, w_mean, w_cov, w, Q, scratch, mean, P):
    """Fill weighted mean and covariance, plus Q, of one filter's points (2n+1, n); return a status."""
    k, n = points.shape
    if k != 2 * n + 1 or Q.shape[0] != n or Q.shape[1] != n:
        return SHAPE_ERROR
    rows = padded(n)
    d, sums = scratch[:rows], scratch[rows:]  # d: one row per component, so that sums are contiguous
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
            return POINTS_ERROR
    squares_into(d, k - 1, sums)
    off = w - w  # stays zero as long as all is finite
    for i in range(n):
        share, here = w_cov * d[i, k - 1], w - w
        for j in range(i + 1):
            value = w * sums[i, j] + share * d[j, k - 1] + 0.5 * (Q[i, j] + Q[j, i])
            here += value - value
            P[i, j] = value
            P[j, i] = value
        off += here
    return OK if off == 0 else Q_NOT_FINITE_ERROR


@kernel(**FILLING, **CONTRACTED)
def wrapped(x):
    """Return an angle in [-pi, pi]."""
    return x - TWO_PI * np.rint(x * (1.0 / TWO_PI))


@kernel(**FILLING, **CONTRACTED)
def deviations_into(images, y, w, angular, d, innovation, predicted):
    """Fill deviations of one filter's images (2n+1, m) from their mean `predicted`, and the innovation; return a
    status.

    In d (m, 2n+1): n differences of opposite images, n sums of their deviations, and the centre's deviation.
    """
    k, m = images.shape
    n = k // 2
    plus, minus, farthest = images[1:], images[n + 1 :], w - w
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
        if angular[a]:
            for s in range(n):  # the larger of two sizes is half that of their sum and difference together
                farthest = max(farthest, abs(row[s]) + abs(opposite[s]))
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
            return IMAGES_ERROR
        if not np.isfinite(z):
            return MEASUREMENT_ERROR
    return OK if farthest <= 2 * MAX_ANGLE_SPREAD else ANGLE_ERROR


@kernel(**FILLING, **CONTRACTED)
def whiten_into(S, innovation, lower, inverse, white):
    """Fill white (m,) = L^-1 innovation, with L L^T = S (m, m); return (whether L exists, NIS).

    L is left in `lower` (m, m), the inverse of its diagonal in `inverse` (m,).
    """
    m = S.shape[0]
    nis = 0.0
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


@kernel((INT, INT), **FILLING)
def correct_scratch_shape(n, m):
    """Return the shape of the scratch of `correct_into`."""
    return 2 * padded(m) + padded(n) + max(padded(n), m + 2), max(2 * n + 1, padded(m))


@kernel(**FILLING, **CONTRACTED)
def innovation_covariance_into(sums, centre, R, w_cov, w, S):
    """Fill S (m, m) from the sums of squares of `deviations_into`, the centre's deviation, and R."""
    m = R.shape[0]
    for a in range(m):
        for b in range(a + 1):
            noise = 0.5 * (w * sums[a, b] + R[a, b] + R[b, a])  # half the squares of sum and difference
            S[a, b] = noise + w_cov * centre[a] * centre[b]
            S[b, a] = S[a, b]


@kernel(**FILLING, **CONTRACTED)
def move_into(centre, cross, w, lower, inverse, white, considered, mean_out):
    """Fill the mean after the update.

    cross (n, m) becomes cross w L^-T; its product with its transpose is K S K^T.
    """
    n, m = centre.shape[0], lower.shape[0]
    for i in range(n):
        step = w - w
        for a in range(m):
            entry = w * cross[i, a]
            for b in range(a):
                entry -= lower[a, b] * cross[i, b]
            entry *= inverse[a]
            cross[i, a] = entry
            step += entry * white[a]
        mean_out[i] = centre[i] + (w - w if considered[i] else step)


@kernel(**FILLING, **CONTRACTED)
def reduce_into(P, reductions, considered, exact, P_out):
    """Fill P minus the `reductions` (n, n), except for pairs of considered states.

    After an `exact` measurement a variance with only rounding left is zero. Returns whether so little is left of
    another one that it has few digits.
    """
    n = P.shape[0]
    rounding = 4 * n * np.finfo(np.float64).eps
    little = MIN_VARIANCE_FACTOR * np.sqrt(np.finfo(np.float64).eps)
    any_considered = cancelled = False
    for i in range(n):
        any_considered |= considered[i]
    if any_considered:
        for i in range(n):
            for j in range(i + 1):
                if considered[i] and considered[j]:
                    reductions[i, j] = 0.0
    for i in range(n):
        cancelled |= P[i, i] - reductions[i, i] < little * P[i, i]
        for j in range(i + 1):
            value = P[j, i] - reductions[i, j]
            P_out[i, j] = value
            P_out[j, i] = value
    if exact:
        for i in range(n):
            if abs(P_out[i, i]) <= rounding * (P_out[i, i] + reductions[i, i]):
                P_out[i, i] = 0.0
        clear_known(P_out)
    return cancelled and not exact


@kernel(**FILLING, **CONTRACTED)
def gain_into(cross, lower, inverse, considered):
    """Replace cross (n, m) = C L^-T by the gain K = C S^-1, zero for considered states."""
    n, m = considered.shape[0], lower.shape[0]
    for i in range(n):
        for a in range(m - 1, -1, -1):
            entry = cross[i, a]
            for b in range(a + 1, m):
                entry -= cross[i, b] * lower[b, a]
            cross[i, a] = inverse[a] - inverse[a] if considered[i] else entry * inverse[a]


@kernel(**FILLING, **CONTRACTED)
def dot(a, b):
    """Return the sum of products of two vectors."""
    total = a[0] * b[0]
    for i in range(1, a.shape[0]):
        total += a[i] * b[i]
    return total


@kernel(**FILLING, **CONTRACTED)
def rebuild_into(points, d, R, w_cov, w, K, even, row, P_out):
    """Fill the covariance as a sum of squares, in which no digits cancel.

    They are of deviations of points minus K (n, m) times those of their images, and K R K^T, as Joseph's form of
    the regression. d: of `deviations_into`; `even` (m, m) and `row` (max(n, m),) are overwritten.
    """
    n, m = P_out.shape[0], R.shape[0]
    for a in range(m):  # R, and what images deviate by that is even about the centre's
        for b in range(m):
            squares = w * dot(d[a, n : 2 * n], d[b, n : 2 * n])
            even[a, b] = 0.5 * (R[a, b] + R[b, a] + squares) + w_cov * d[a, 2 * n] * d[b, 2 * n]
    for i in range(n):
        for a in range(m):
            row[a] = dot(K[i, :m], even[:m, a])
        for j in range(i + 1):
            P_out[i, j] = P_out[j, i] = dot(row[:m], K[j, :m])
    for s in range(n):
        for i in range(n):
            row[i] = 0.5 * (points[1 + s, i] - points[1 + n + s, i] - dot(K[i, :m], d[:m, s]))
        for i in range(n):
            for j in range(i + 1):
                P_out[i, j] += (w + w) * row[i] * row[j]
                P_out[j, i] = P_out[i, j]


@kernel(**FILLING)
def smallest_variance(P):
    """Return the smallest number on the diagonal of P (n, n)."""
    smallest = P[0, 0]
    for i in range(1, P.shape[0]):
        smallest = min(smallest, P[i, i])
    return smallest


class CorrectedPoints(NamedTuple):
    """Outputs of `correct_into`.

    They are mean (n,), covariance (n, n), innovation (m,), its covariance (m, m), and the predicted measurement
    (m,).
    """

    mean: Array
    covariance: Array
    innovation: Array
    S: Array
    predicted: Array


@kernel(**FILLING, **CONTRACTED)
def correct_into(points, images, P, y, R, w_cov, w, angular, considered, scratch, out):
    """Update one filter from its points (2n+1, n) and their images (2n+1, m) into `out`; return (status, NIS)."""
    mean_out, P_out, innovation, S, predicted = out
    k, n = points.shape
    m = y.shape[0]
    if images.shape[0] != k or images.shape[1] != m or R.shape[0] != m or R.shape[1] != m:
        return SHAPE_ERROR, 0.0
    few, many = padded(m), padded(n)
    d, sums, rest = scratch[:few], scratch[few : 2 * few], scratch[2 * few :]
    cross, reductions = rest[:many], rest[many:]
    for a in range(m, few):
        for s in range(k):
            d[a, s] = 0.0
    for i in range(n, many):
        for a in range(m):
            cross[i, a] = 0.0
    status = deviations_into(images, y, w, angular, d, innovation, predicted)
    if status != OK:
        return status, 0.0
    squares_into(d, k - 1, sums)
    innovation_covariance_into(sums, d[:, k - 1], R, w_cov, w, S)
    lower, inverse, white = reductions[:m], reductions[m], reductions[m + 1]  # overwritten by the reductions below
    exists, nis = whiten_into(S, innovation, lower, inverse, white)
    if not exists:
        return INNOVATION_ERROR, 0.0
    offsets_by_into(points, d, m, cross)  # the set is symmetric: differences of opposite images are enough
    move_into(points[0], cross, w, lower, inverse, white, considered, mean_out)
    if m > 0:
        squares_into(cross, m, reductions)  # K S K^T
    else:
        reductions[:] = 0.0
    exact = False
    for a in range(m):
        exact |= R[a, a] == 0
    if reduce_into(P, reductions, considered, exact, P_out):
        whiten_into(S, innovation, lower, inverse, white)
        gain_into(cross, lower, inverse, considered)
        rebuild_into(points, d, R, w_cov, w, cross, sums, white, P_out)
    return OK if smallest_variance(P_out) >= 0 else POSTERIOR_ERROR, nis
