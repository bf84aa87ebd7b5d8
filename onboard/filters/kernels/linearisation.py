"""Compiled linearisation: Jacobians by central differences, regression about a belief, and the smoother's pass.

Batches as in `linear`.
"""

import numpy as np

from onboard.compiled import FLAGS, INT, MAKING, kernel, signature
from onboard.filters.errors import (
    COVARIANCE_ERROR,
    IMAGES_ERROR,
    MATRIX_ERROR,
    MEAN_ERROR,
    MEMBER_FACTOR,
    OK,
    PREDICTED_ERROR,
    Q_INDEFINITE_ERROR,
    Q_NOT_FINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import is_noise, root_into, skip_known
from onboard.filters.kernels.images import centred_into, skips_centre
from onboard.filters.kernels.linear import common_batch, is_finite, joseph_into, sandwich_into, solve_into
from onboard.filters.kernels.sigma_points import wrapped


@kernel(signature(2, 3), **MAKING)
def stencil(mean, P):
    """Return (points (B, 2n+1, n), status): the mean, then a step forth and a step back along each axis.

    A step is eps^(1/4) of a standard deviation. The difference then misses sqrt(eps)/6 of the cubic term over that
    deviation, far less than the tangent itself misses, and rounding adds eps^(3/4) of the value. A step is at
    least sqrt(eps) of the state, which large coordinates need.
    """
    count, n = common_batch((mean.shape[0], P.shape[0])), mean.shape[1]
    points = np.empty((max(count, 0), 2 * n + 1, n))
    if count < 0 or P.shape[1:] != (n, n):
        return points, SHAPE_ERROR
    eps = np.finfo(np.float64).eps
    for b in range(count):
        centre, covariance = mean[b % mean.shape[0]], P[b % P.shape[0]]
        for s in range(2 * n + 1):
            for i in range(n):
                points[b, s, i] = centre[i]
        for i in range(n):
            if not np.isfinite(centre[i]):
                return points, MEAN_ERROR + MEMBER_FACTOR * b
            if not (covariance[i, i] >= 0 and covariance[i, i] < np.inf):
                return points, COVARIANCE_ERROR + MEMBER_FACTOR * b
            step = max(eps**0.25 * np.sqrt(covariance[i, i]), np.sqrt(eps) * abs(centre[i]))
            if not step > 0:
                step = eps**0.25
            points[b, 1 + i, i] = centre[i] + step
            points[b, 1 + n + i, i] = centre[i] - step
    return points, OK


@kernel(signature(3, 3, FLAGS, INT), **MAKING)
def slopes(points, images, angular, fault):
    """Return (Jacobian (B, m, n), status) from a stencil and its images (B, 2n+1, m).

    The status is `fault` if the images are not finite.
    """
    count, size, n = points.shape
    m = images.shape[2]
    jacobian = np.empty((count, m, n))
    if images.shape[0] != count or images.shape[1] != size or angular.shape[0] != m:
        return jacobian, SHAPE_ERROR
    for b in range(count):
        for i in range(n):
            width = points[b, 1 + i, i] - points[b, 1 + n + i, i]  # the represented step, not the requested one
            for a in range(m):
                rise = images[b, 1 + i, a] - images[b, 1 + n + i, a]
                jacobian[b, a, i] = (wrapped(rise) if angular[a] else rise) / width
        if not is_finite(jacobian[b]):
            return jacobian, fault + MEMBER_FACTOR * b
    return jacobian, OK


@kernel(signature(3, 3, "f", "f", FLAGS, INT), **MAKING)
def regress(P, images, w_cov, w, angular, fault):
    """Return the statistical linear regression of images (B, 2n+1, m) of sigma points of covariance P (B, n, n).

    (slope A (B, m, n), value at the mean (B, m), covariance of the residual (B, m, m), status); the status is
    `fault` if the images are not finite.
    """
    count, size, m = images.shape
    n = P.shape[1]
    A, value = np.empty((count, m, n)), np.empty((count, m))
    rest = np.empty((count, m, m))
    if P.shape[0] != count or P.shape[2] != n or size != 2 * n + 1 or angular.shape[0] != m:
        return A, value, rest, SHAPE_ERROR
    d, lower_t = np.empty((m, size)), np.empty((n, n))
    root = np.sqrt(0.5 * w)
    for b in range(count):
        if not root_into(P[b], lower_t):
            return A, value, rest, COVARIANCE_ERROR + MEMBER_FACTOR * b
        skip_known(lower_t)
        status = centred_into(images[b], w, skips_centre(images[b], w_cov), angular, value[b], d)
        if status != OK:
            return A, value, rest, (fault if status == IMAGES_ERROR else status) + MEMBER_FACTOR * b
        for a in range(m):
            for i in range(n - 1, -1, -1):  # A L = the odd part of the deviations; L lower, so from the right
                odd = root * (d[a, 1 + i] - d[a, 1 + n + i])
                for j in range(i + 1, n):
                    odd -= A[b, a, j] * lower_t[i, j]
                A[b, a, i] = odd / lower_t[i, i]
        for a in range(m):
            for c in range(a, m):
                total = w_cov * d[a, 0] * d[c, 0]
                for i in range(1, n + 1):
                    total += root * (d[a, i] + d[a, n + i]) * root * (d[c, i] + d[c, n + i])
                rest[b, a, c] = total
                rest[b, c, a] = total
    return A, value, rest, OK


@kernel(**MAKING)
def smooth_into(mean, P, F, Q, predicted, mean_next, P_next, mean_out, P_out):
    """Fill one step back of Rauch, Tung and Striebel; return a status.

    The covariance is in Joseph's form, (I - G F) P (I - G F)^T + G (P_next + Q) G^T: no difference of covariances.
    """
    n = mean.shape[0]
    forecast, lower_t = np.empty((n, n)), np.empty((n, n))
    if not is_finite(F):
        return MATRIX_ERROR
    if not is_finite(Q):
        return Q_NOT_FINITE_ERROR
    if not is_noise(Q, lower_t):
        return Q_INDEFINITE_ERROR
    sandwich_into(F, P, Q, forecast)
    if not root_into(forecast, lower_t):
        return PREDICTED_ERROR
    skip_known(lower_t)
    G, noise = np.zeros((n, n)), np.empty((n, n))
    for i in range(n):
        for k in range(n):
            for j in range(n):
                G[i, k] += P[i, j] * F[k, j]
    solve_into(lower_t, G)
    for i in range(n):
        mean_out[i] = mean[i]
        for k in range(n):
            mean_out[i] += G[i, k] * (mean_next[k] - predicted[k])
            noise[i, k] = P_next[i, k] + Q[i, k]
        if not np.isfinite(mean_out[i]):
            return MEAN_ERROR
    joseph_into(P, F, G, noise, P_out)
    return OK


@kernel(signature(3, 4, 4, 4, 3), **MAKING)
def smooth_back(mean, P, F, Q, predicted):
    """Smooth filtered means (T, B, n) and covariances (T, B, n, n) from the end.

    F, Q (T-1, B, n, n), and predicted (T-1, B, n), belong to the steps. Returns (mean, covariance, status).
    """
    steps, count, n = mean.shape
    mean_out, P_out = np.empty((steps, count, n)), np.empty((steps, count, n, n))
    if P.shape != (steps, count, n, n) or predicted.shape != (steps - 1, count, n):
        return mean_out, P_out, SHAPE_ERROR
    if F.shape != (steps - 1, count, n, n) or Q.shape != F.shape:
        return mean_out, P_out, SHAPE_ERROR
    lower_t = np.empty((n, n))
    for b in range(count):
        for t in range(steps - 1, -1, -1):
            if not root_into(P[t, b], lower_t):
                return mean_out, P_out, COVARIANCE_ERROR + MEMBER_FACTOR * b
            if t == steps - 1:
                mean_out[t, b] = mean[t, b]
                P_out[t, b] = P[t, b]
                continue
            status = smooth_into(
                mean[t, b], P[t, b], F[t, b], Q[t, b], predicted[t, b],
                mean_out[t + 1, b], P_out[t + 1, b], mean_out[t, b], P_out[t, b],
            )  # fmt: skip
            if status != OK:
                return mean_out, P_out, status + MEMBER_FACTOR * b
    return mean_out, P_out, OK
