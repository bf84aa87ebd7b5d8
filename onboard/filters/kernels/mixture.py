"""Compiled arithmetic of mixtures of beliefs, of r modes of one filter, for `multiple_model`."""

import numpy as np

from onboard.compiled import FILLING, MAKING, kernel
from onboard.filters.errors import INNOVATION_ERROR, OK
from onboard.filters.kernels.cholesky import factor_into
from onboard.filters.kernels.sigma_points import TWO_PI


@kernel(**FILLING)
def mix_into(means, P, weights, mean_out, P_out):
    """Fill mean and covariance of the mixture of means (r, n) and covariances (r, n, n) with weights (r,).

    Sums are relative to the first mode: a mixture of equal modes is then that mode to the last digit, at any
    distance from zero.
    """
    r, n = means.shape
    for a in range(n):
        total = 0.0
        for k in range(1, r):
            total += weights[k] * (means[k, a] - means[0, a])
        mean_out[a] = means[0, a] + total
    for a in range(n):
        for b in range(a, n):
            base = 0.5 * (P[0, a, b] + P[0, b, a])
            total = 0.0
            for k in range(r):
                spread = (means[k, a] - mean_out[a]) * (means[k, b] - mean_out[b])
                total += weights[k] * (0.5 * (P[k, a, b] + P[k, b, a]) - base + spread)
            P_out[a, b] = P_out[b, a] = base + total


@kernel(**MAKING)
def weigh_into(innovations, S, nis, prior, angular, log_l, posterior, mean, P):
    """Like `weigh`, for one filter; return (status, NIS)."""
    r, m = innovations.shape
    lower_t, e, status = np.empty((m, m)), np.empty((r, m)), OK
    best = -np.inf
    for k in range(r):
        if not factor_into(S[k], lower_t):
            status = INNOVATION_ERROR
        log_det = m * np.log(TWO_PI)
        for a in range(m):
            log_det += 2.0 * np.log(lower_t[a, a])
            e[k, a] = innovations[k, a]
            if angular[a]:
                e[k, a] -= TWO_PI * np.rint((e[k, a] - e[0, a]) / TWO_PI)
        log_l[k] = -0.5 * (nis[k] + log_det)
        if prior[k] > 0 and log_l[k] > -np.inf:
            best = max(best, np.log(prior[k]) + log_l[k])
    total = 0.0
    for k in range(r):
        score = np.exp(np.log(prior[k]) + log_l[k] - best) if prior[k] > 0 and log_l[k] > -np.inf else 0.0
        if best == -np.inf:  # underflow in all modes: their probabilities stay
            score = prior[k]
        posterior[k] = score
        total += score
    for k in range(r):
        posterior[k] /= total
    mix_into(e, S, prior, mean, P)
    if not factor_into(P, lower_t):
        status = INNOVATION_ERROR
    value = 0.0
    for a in range(m):  # e[0] becomes the whitened innovation
        white = mean[a]
        for c in range(a):
            white -= lower_t[c, a] * e[0, c]
        e[0, a] = white / lower_t[a, a]
        value += e[0, a] * e[0, a]
    return status, value
