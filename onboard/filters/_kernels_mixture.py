"""Compiled arithmetic of mixtures of beliefs, a batch B of r modes each; see `_kernels`."""

import numpy as np
from numba import njit

from onboard.filters._kernels import FLAGS, TWO_PI, _signatures, factor_into
from onboard.filters.belief import INNOVATION, OK
from onboard.filters.compiled import FILLING


@njit(**FILLING)
def mix_into(means, P, weights, mean_out, P_out):  # type: ignore[no-untyped-def]
    """Mean and covariance of the mixture of means (r, n) and covariances (r, n, n) with weights (r,). Taken about
    the first mode: a mixture of equals is then that mode to the last digit, however far from zero."""
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


@njit(_signatures(3, 4, 3), cache=True, error_model="numpy")
def mix(means, P, weights):  # type: ignore[no-untyped-def]
    """(means (B, j, n), covariances (B, j, n, n)): a mixture for each column of weights (B, r, j)."""
    count, _, n = means.shape
    j = weights.shape[2]
    mean_out, P_out = np.empty((count, j, n), means.dtype), np.empty((count, j, n, n), means.dtype)
    for b in range(count):
        for c in range(j):
            mix_into(means[b], P[b], weights[b, :, c], mean_out[b, c], P_out[b, c])
    return mean_out, P_out


@njit(**FILLING)
def pass_into(prior, transition, ahead, mixing):  # type: ignore[no-untyped-def]
    """The modes' probabilities (r,) `ahead` after passing from one to another by `transition` (r, r), and in
    column j of `mixing` (r, r) how much of each mode is in mode j then; one that nothing leads to keeps itself."""
    r, total = prior.shape[0], 0.0
    for j in range(r):
        ahead[j] = 0.0
        for i in range(r):
            mixing[i, j] = prior[i] * transition[i, j]
            ahead[j] += mixing[i, j]
        for i in range(r):
            if ahead[j] > 0:
                mixing[i, j] /= ahead[j]
            else:
                mixing[i, j] = 1.0 if i == j else 0.0
        total += ahead[j]
    for j in range(r):
        ahead[j] /= total


@njit(cache=True, error_model="numpy")
def weigh_into(innovations, S, nis, prior, angular, log_l, posterior, mean, P):  # type: ignore[no-untyped-def]
    """As `weigh`, of one filter; (status, NIS)."""
    r, m = innovations.shape
    lower_t, e, status = np.empty((m, m), S.dtype), np.empty((r, m), S.dtype), OK
    best = -np.inf
    for k in range(r):
        if not factor_into(S[k], lower_t):
            status = INNOVATION
        log_det = m * np.log(TWO_PI)
        for a in range(m):
            log_det += 2.0 * np.log(lower_t[a, a])
            e[k, a] = innovations[k, a]
            if angular[a]:
                e[k, a] -= TWO_PI * np.rint((e[k, a] - e[0, a]) / TWO_PI)
        log_l[k] = -0.5 * (nis[k] + log_det)
        if prior[k] > 0:
            best = max(best, np.log(prior[k]) + log_l[k])
    total = 0.0
    for k in range(r):
        score = np.exp(np.log(prior[k]) + log_l[k] - best) if prior[k] > 0 else 0.0
        posterior[k] = score
        total += score
    for k in range(r):
        posterior[k] /= total
    mix_into(e, S, prior, mean, P)
    if not factor_into(P, lower_t):
        status = INNOVATION
    value = 0.0
    for a in range(m):  # e[0] becomes the whitened innovation
        white = mean[a]
        for c in range(a):
            white -= lower_t[c, a] * e[0, c]
        e[0, a] = white / lower_t[a, a]
        value += e[0, a] * e[0, a]
    return status, value


@njit(_signatures(3, 4, 2, 2, FLAGS), cache=True, error_model="numpy")
def weigh(innovations, S, nis, prior, angular):  # type: ignore[no-untyped-def]
    """(log-likelihoods (B, r), posterior (B, r), innovation (B, m), covariance (B, m, m), NIS (B,), status) of
    modes with innovations (B, r, m), S (B, r, m, m), nis and prior probabilities (B, r). Angles are averaged as
    innovations, which are small, not as angles, which break."""
    count, r, m = innovations.shape
    dtype = innovations.dtype
    log_l, posterior = np.empty((count, r), dtype), np.empty((count, r), dtype)
    mean, P, mixed_nis = np.empty((count, m), dtype), np.empty((count, m, m), dtype), np.empty(count, dtype)
    status = OK
    for b in range(count):
        found, mixed_nis[b] = weigh_into(
            innovations[b], S[b], nis[b], prior[b], angular, log_l[b], posterior[b], mean[b], P[b]
        )
        if found != OK:
            status = found
    return log_l, posterior, mean, P, mixed_nis, status
