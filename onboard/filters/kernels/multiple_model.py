"""Kernels of `filters.multiple_model`: the arithmetic of `mixture` for a batch of filters."""

import numpy as np

from onboard.compiled import FLAGS, MAKING, kernel, signature
from onboard.filters.errors import MEMBER_FACTOR, OK
from onboard.filters.kernels.mixture import mix_into, weigh_into


@kernel(signature(3, 4, 3), **MAKING)
def mix(means, P, weights):
    """Return (means (B, j, n), covariances (B, j, n, n)): a mixture for each column of weights (B, r, j)."""
    count, _, n = means.shape
    j = weights.shape[2]
    mean_out, P_out = np.empty((count, j, n)), np.empty((count, j, n, n))
    for b in range(count):
        for c in range(j):
            mix_into(means[b], P[b], weights[b, :, c], mean_out[b, c], P_out[b, c])
    return mean_out, P_out


@kernel(signature(3, 4, 2, 2, FLAGS), **MAKING)
def weigh(innovations, S, nis, prior, angular):
    """Weigh modes by their innovations (B, r, m), S (B, r, m, m), nis and prior probabilities (B, r).

    Returns (log-likelihoods (B, r), posterior (B, r), innovation (B, m), covariance (B, m, m), NIS (B,), status).
    Angles are averaged as innovations, which are small: a mean of the angles themselves would break at +-pi.
    """
    count, r, m = innovations.shape
    log_l, posterior = np.empty((count, r)), np.empty((count, r))
    mean, P, mixed_nis = np.empty((count, m)), np.empty((count, m, m)), np.empty(count)
    status = OK
    for b in range(count):
        found, mixed_nis[b] = weigh_into(
            innovations[b], S[b], nis[b], prior[b], angular, log_l[b], posterior[b], mean[b], P[b]
        )
        if found != OK and status == OK:
            status = found + MEMBER_FACTOR * b
    return log_l, posterior, mean, P, mixed_nis, status
