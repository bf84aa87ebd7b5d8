"""The Kalman filter over a whole record in one compiled loop, for `runs.run`."""

import numpy as np

from onboard.compiled import FLAGS, MAKING, kernel, signature
from onboard.filters.errors import OK, Q_INDEFINITE_ERROR
from onboard.filters.kernels.cholesky import factor_into, is_noise
from onboard.filters.kernels.linear import Corrected, correct_into, sandwich_into
from onboard.filters.kernels.sigma_points import TWO_PI


@kernel(**MAKING)
def correct_present_into(mean, P, y, H, R, angular, mean_out, P_out, innovation, S, predicted):
    """Update by the components of y (m,) that are not NaN; return (status, NIS, log-likelihood).

    Outputs of a missing component stay NaN. Without any component, mean and covariance stay.
    """
    n, m = mean.shape[0], y.shape[0]
    present = np.empty(m, np.int64)
    count = 0
    for a in range(m):
        value = 0.0
        for i in range(n):
            value += H[a, i] * mean[i]
        predicted[a] = value
        innovation[a] = np.nan
        for c in range(m):
            S[a, c] = np.nan
        if not np.isnan(y[a]):
            present[count] = a
            count += 1
    if count == 0:
        mean_out[:] = mean
        P_out[:] = P
        return OK, 0.0, 0.0
    h, r, s = np.empty((count, n)), np.empty((count, count)), np.empty((count, count))
    seen, e, forecast = np.empty(count), np.empty(count), np.empty(count)
    wraps, considered = np.empty(count, np.bool_), np.zeros(n, np.bool_)
    for i in range(count):
        a = present[i]
        h[i] = H[a]
        seen[i], forecast[i], wraps[i] = y[a], predicted[a], angular[a]
        for j in range(count):
            r[i, j] = R[a, present[j]]
    out = Corrected(mean_out, P_out, e, s)
    status, nis = correct_into(mean, P, h, forecast, seen, r, wraps, considered, out)
    if status != OK:
        return status, 0.0, 0.0
    factor_into(s, r)
    log_l = -0.5 * nis
    for i in range(count):
        log_l -= np.log(r[i, i]) + 0.5 * np.log(TWO_PI)
        innovation[present[i]] = e[i]
        for j in range(count):
            S[present[i], present[j]] = s[i, j]
    return OK, nis, log_l


@kernel(signature(2, 3, 3, 3, 2, 3, 3, 3, FLAGS), nogil=True, **MAKING)  # records in threads, side by side
def filter_record(mean, P, F, Q, inputs, H, R, y, angular):
    """Filter the measurements y (T, B, m), NaN where missing, from mean (B, n) and covariance (B, n, n).

    The first belief is at the time of the first measurement. F, Q (T-1 or 1, n, n) and inputs (T-1 or 1, n) lead
    from each time to the next; H (T or 1, m, n), R (T or 1, m, m). Returns (predicted mean (T, B, n) and
    covariance, mean and covariance after the update, innovation (T, B, m), its covariance, the predicted
    measurement, NIS (T, B), log-likelihood, status). It ends where a filter fails.
    """
    steps, count, m = y.shape
    n = mean.shape[1]
    prior, prior_P = np.empty((steps, count, n)), np.empty((steps, count, n, n))
    after, after_P = np.empty((steps, count, n)), np.empty((steps, count, n, n))
    innovation, S = np.empty((steps, count, m)), np.empty((steps, count, m, m))
    predicted = np.empty((steps, count, m))
    nis, log_l = np.empty((steps, count)), np.empty((steps, count))
    scratch = np.empty((n, n))
    for q in range(len(Q)):
        if steps > 1 and not is_noise(Q[q], scratch):
            return prior, prior_P, after, after_P, innovation, S, predicted, nis, log_l, Q_INDEFINITE_ERROR
    for k in range(steps):
        f, q, u, h, r = (k - 1) % len(F), (k - 1) % len(Q), (k - 1) % len(inputs), k % len(H), k % len(R)
        for b in range(count):
            if k == 0:
                prior[k, b] = mean[b]
                prior_P[k, b] = P[b]
            else:
                for i in range(n):
                    value = inputs[u, i]
                    for j in range(n):
                        value += F[f, i, j] * after[k - 1, b, j]
                    prior[k, b, i] = value
                sandwich_into(F[f], after_P[k - 1, b], Q[q], prior_P[k, b])
            status, nis[k, b], log_l[k, b] = correct_present_into(
                prior[k, b], prior_P[k, b], y[k, b], H[h], R[r], angular,
                after[k, b], after_P[k, b], innovation[k, b], S[k, b], predicted[k, b],
            )  # fmt: skip
            if status != OK:
                return prior, prior_P, after, after_P, innovation, S, predicted, nis, log_l, status
    return prior, prior_P, after, after_P, innovation, S, predicted, nis, log_l, OK
