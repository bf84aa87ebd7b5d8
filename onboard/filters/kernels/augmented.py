"""Compiled arithmetic of the noise-augmented unscented filter, over a batch, with more than 2n + 1 points."""

import numpy as np

from onboard.compiled import FLAGS, MAKING, kernel, signature
from onboard.filters.errors import (
    ANGLE_ERROR,
    COVARIANCE_ERROR,
    IMAGES_ERROR,
    INNOVATION_ERROR,
    MAX_ANGLE_SPREAD,
    MEMBER_FACTOR,
    OK,
    POINTS_ERROR,
    POSTERIOR_ERROR,
    Q_INDEFINITE_ERROR,
    R_INDEFINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import clear_known, factor_into, root_into, semifactor_into
from onboard.filters.kernels.linear import innovate_into
from onboard.filters.kernels.sigma_points import MIN_VARIANCE_FACTOR, wrapped


@kernel(signature(2, 3, 3, 3, "f"), **MAKING)
def spread(mean, P, first, second, gamma):  # noqa: PLR0912 - loops
    """Return (points (B, 2L+1, L), status): the mean first, and opposite points L apart (eqs 8, 9).

    Means are (B, n), covariances (B, n, n) and those of two noises each (B or 1, k, k), perhaps singular or empty.
    """
    count, n = mean.shape
    k1, k2 = first.shape[1], second.shape[1]
    L = n + k1 + k2
    points = np.zeros((count, 2 * L + 1, L))
    if P.shape[0] != count or P.shape[1] != n or P.shape[2] != n:
        return points, SHAPE_ERROR
    if first.shape[2] != k1 or second.shape[2] != k2:
        return points, SHAPE_ERROR
    if first.shape[0] not in (1, count) or second.shape[0] not in (1, count):
        return points, SHAPE_ERROR
    own, one, two = np.empty((n, n)), np.empty((k1, k1)), np.empty((k2, k2))
    for b in range(count):
        if not root_into(P[b], own):
            return points, COVARIANCE_ERROR + MEMBER_FACTOR * b
        if not semifactor_into(first[b % first.shape[0]], one):
            return points, Q_INDEFINITE_ERROR + MEMBER_FACTOR * b
        if not semifactor_into(second[b % second.shape[0]], two):
            return points, R_INDEFINITE_ERROR + MEMBER_FACTOR * b
        for s in range(2 * L + 1):
            for i in range(n):
                points[b, s, i] = mean[b, i]
        for j in range(L):
            for i in range(j, L):
                offset = 0.0
                if i < n:
                    offset = own[j, i]
                elif n <= j and i < n + k1:
                    offset = one[i - n, j - n]
                elif n + k1 <= j:
                    offset = two[i - n - k1, j - n - k1]
                points[b, 1 + j, i] += gamma * offset
                points[b, 1 + L + j, i] -= gamma * offset
    return points, OK


@kernel(**MAKING)
def centred_into(points, w, angular, mean, d):
    """Fill the mean (m,) of points (k, m) and the deviations from it (k, m); return a status.

    It is IMAGES_ERROR if they are not finite. Sums are relative to the first point.
    """
    k, m = points.shape
    is_finite, farthest = True, 0.0
    for a in range(m):
        total = 0.0
        for s in range(k):
            d[s, a] = points[s, a] - points[0, a]
            if angular[a]:
                d[s, a] = wrapped(d[s, a])
                farthest = max(farthest, abs(d[s, a]))
            total += d[s, a]
        mean[a] = points[0, a] + w * total
        for s in range(k):
            d[s, a] -= w * total
        is_finite = is_finite and np.isfinite(mean[a])
    if not is_finite:
        return IMAGES_ERROR
    return OK if farthest <= MAX_ANGLE_SPREAD else ANGLE_ERROR


@kernel(**MAKING)
def covariance_into(d, w_cov, w, P):
    """Fill the weighted covariance of deviations (k, m)."""
    k, m = d.shape
    for a in range(m):
        for b in range(a, m):
            total = 0.0
            for s in range(1, k):
                total += d[s, a] * d[s, b]
            P[a, b] = P[b, a] = w * total + w_cov * d[0, a] * d[0, b]


@kernel(signature(3, "f", "f"), **MAKING)
def gather(points, w_cov, w):
    """Return (mean (B, n), covariance (B, n, n), status) of points (B, k, n)."""
    count, k, n = points.shape
    mean, P = np.empty((count, n)), np.empty((count, n, n))
    d, no_angles = np.empty((k, n)), np.zeros(n, np.bool_)
    for b in range(count):
        if centred_into(points[b], w, no_angles, mean[b], d) != OK:
            return mean, P, POINTS_ERROR + MEMBER_FACTOR * b
        covariance_into(d, w_cov, w, P[b])
    return mean, P, OK


@kernel(**MAKING)
def whiten_into(points, mean, d, e, lower_t, w_cov, w, white):
    """Fill chol(S)^-1 [cross-covariance^T, e] (m, n+1).

    Inputs are points (k, n) and their images' deviations d (k, m).
    """
    (k, n), m = points.shape, e.shape[0]
    for a in range(m):
        for i in range(n):
            total = w_cov * d[0, a] * (points[0, i] - mean[i])
            for s in range(1, k):
                total += w * d[s, a] * (points[s, i] - mean[i])
            white[a, i] = total
        white[a, n] = e[a]
        for c in range(a):
            for i in range(n + 1):
                white[a, i] -= lower_t[c, a] * white[c, i]
        for i in range(n + 1):
            white[a, i] /= lower_t[a, a]


@kernel(**MAKING)
def rebuild_into(points, mean, d, lower_t, half, w_cov, w, P_out):
    """Fill the covariance as a sum of squares, in which no digits cancel.

    They are of deviations of points (k, n) minus the gain times those of their images (k, m), which include the
    noise. half: chol(S)^-1 times the cross-covariance.
    """
    k, m, n = points.shape[0], d.shape[1], mean.shape[0]
    gain, off = np.empty((n, m)), np.empty((k, n))
    for i in range(n):
        for a in range(m - 1, -1, -1):
            gain[i, a] = (half[a, i] - np.sum(gain[i, a + 1 :] * lower_t[a, a + 1 :])) / lower_t[a, a]
        for s in range(k):
            off[s, i] = points[s, i] - mean[i] - np.sum(gain[i] * d[s])
    covariance_into(off, w_cov, w, P_out)


@kernel(signature(2, 3, 3, 3, 2, 3, "f", "f", FLAGS), **MAKING)
def correct(mean, P, points, images, y, R, w_cov, w, angular):
    """Update from points (B, k, n), which need not be symmetric, and their images (B, k, m).

    The images contain the noise of covariance R (B or 1, n_v, n_v) (eq 12); y is (B, m). Returns (mean (B, n),
    covariance, innovation (B, m), S, predicted, NIS, status).
    """
    (count, n), (k, m) = mean.shape, (points.shape[1], y.shape[1])
    mean_out, P_out, nis = mean.copy(), np.empty((count, n, n)), np.zeros(count)
    e, S, predicted = np.empty((count, m)), np.empty((count, m, m)), np.empty((count, m))
    d, lower_t, white = np.empty((k, m)), np.empty((m, m)), np.empty((m, n + 1))
    rounding = (4.0 * n) * np.finfo(np.float64).eps
    little = MIN_VARIANCE_FACTOR * np.sqrt(np.finfo(np.float64).eps)
    status = OK if y.shape[0] == count and images.shape[1] == k and images.shape[2] == m else SHAPE_ERROR
    for b in range(count):
        if status == OK:
            status = centred_into(images[b], w, angular, predicted[b], d)
        if status == OK:
            covariance_into(d, w_cov, w, S[b])
            status = innovate_into(y[b], predicted[b], angular, e[b])
            status = INNOVATION_ERROR if status == OK and not factor_into(S[b], lower_t) else status
        if status != OK:
            status += MEMBER_FACTOR * b
            break
        whiten_into(points[b], mean[b], d, e[b], lower_t, w_cov, w, white)
        half, last, exact = white[:, :n], white[:, n], False
        for a in range(R.shape[1]):
            exact |= R[b % R.shape[0], a, a] == 0
        nis[b] = np.sum(last * last)
        cancelled = False
        for i in range(n):
            mean_out[b, i] += np.sum(half[:, i] * last)
            cancelled |= not exact and P[b, i, i] - np.sum(half[:, i] ** 2) < little * P[b, i, i]
            for j in range(i, n):
                reduction = np.sum(half[:, i] * half[:, j])
                P_out[b, i, j] = P_out[b, j, i] = 0.5 * (P[b, i, j] + P[b, j, i]) - reduction
            if exact and abs(P_out[b, i, i]) <= rounding * P[b, i, i]:  # as in `sigma_points.reduce_into`
                P_out[b, i, i] = 0.0
        clear_known(P_out[b])
        if cancelled:
            rebuild_into(points[b], mean[b], d, lower_t, half, w_cov, w, P_out[b])
        if np.min(np.diag(P_out[b])) < 0:
            status = POSTERIOR_ERROR + MEMBER_FACTOR * b
            break
    return mean_out, P_out, e, S, predicted, nis, status
