"""Compiled arithmetic of `summary`: the moments of a cloud, and a summary as the belief that is published."""

from typing import Final

import numpy as np
from numba import njit, types

from onboard.filters.compiled import OUT, ROWS, VECTOR, out, packed
from onboard.models import apparent_wing
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, BASE, HEADING
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE

# the components of a summary (N,)
R_FL: Final = slice(0, 3)
V_L: Final = slice(3, 6)
A_L: Final = slice(6, 9)
OWN_VELOCITY: Final = slice(9, 12)
LOG_SIZE: Final = 12
NOSE: Final = 13
BANK: Final = 14
N: Final = 15
VECTORS: Final = 9  # of them, position, velocity and acceleration, which a cloud has in the same places
# of a summary, and of a particle: what both of them have
OF_SUMMARY: Final = (*range(VECTORS), LOG_SIZE, BANK)
OF_PARTICLE: Final = (*range(VECTORS), apparent_wing.LOG_SIZE, apparent_wing.BANK_ERROR)
SLOW: Final = 1.0  # m/s, of a course

NUMBER: Final = types.float64
CLOUD: Final = packed(NUMBER, 1), packed(NUMBER, 2), packed(NUMBER, 1)
VECTOR_OUT: Final = out(NUMBER, 1)


@njit(cache=True, error_model="numpy")
def _components(nose, x, about, period, row):
    """A particle's mean as components of a summary, into `row`. Noses repeat after `period`."""
    for i in range(VECTORS):
        row[i] = x[i]
    row[NOSE] = nose - period * np.rint((nose - about) / period)
    row[LOG_SIZE] = x[apparent_wing.LOG_SIZE]
    row[BANK] = x[apparent_wing.BANK_ERROR]


@njit((*CLOUD, NUMBER, NUMBER, ROWS, VECTOR_OUT, OUT), cache=True, error_model="numpy")
def moments(noses, means, w, about, period, within, mean, S):
    """Mean and covariance of a cloud (`cloud.Cloud`) with weights w (K,), whose particles have the mean covariance
    `within` (W, W), added to `mean` (N,) and S (N, N); and the mean logarithm of the range. Each nose is taken as
    near to `about` as it may be: it repeats after `period`, rad."""
    row, log_range, width = (
        np.zeros(N),
        0.0,
        S.shape[1],
    )  # not known to the compiler: `particle_update`
    for k in range(w.shape[0]):
        x = means[k]
        _components(noses[k], x, about, period, row)
        for i in range(N):
            mean[i] += w[k] * row[i]
        log_range += 0.5 * w[k] * np.log(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for k in range(w.shape[0]):
        _components(noses[k], means[k], about, period, row)
        for i in range(N):
            row[i] -= mean[i]
        for i in range(N):
            if i < VECTORS or i >= LOG_SIZE:
                share = w[k] * row[i]
                for j in range(width):
                    S[i, j] += share * row[j]
    for i in range(len(OF_SUMMARY)):
        for j in range(len(OF_SUMMARY)):
            S[OF_SUMMARY[i], OF_SUMMARY[j]] += within[OF_PARTICLE[i], OF_PARTICLE[j]]
    return log_range


@njit(
    types.int64(VECTOR, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER, NUMBER),
    cache=True,
    error_model="numpy",
)
def occupied(noses, log_range, w, turn, nose_bin, range_bin, least):
    """How many bins of noses (K,), which repeat after `turn`, and of logarithms of ranges (K,) have at least so
    much of the weights w (K,)."""
    size, nothing, last = 1, np.int64(-(1 << 62)), 1e15  # what is no number is in the last bin
    while size < 2 * w.shape[0]:  # so much room that few keys meet
        size *= 2
    keys, weights = np.full(size, nothing), np.zeros(size)
    for k in range(w.shape[0]):
        bin_ = np.floor(noses[k] % turn / nose_bin) + 1000.0 * np.floor(log_range[k] / range_bin)
        key = np.int64(bin_) if abs(bin_) < last else np.int64(last)
        at = key & (size - 1)
        while keys[at] != key and keys[at] != nothing:
            at = (at + 1) & (size - 1)
        keys[at] = key
        weights[at] += w[k]
    found = 0
    for weight in weights:
        found += 1 if weight > least else 0
    return found


@njit(cache=True, error_model="numpy")
def _derivatives(known, dt, J):
    """Of the leader's components (BASE,) by a summary `dt` seconds before, into J (BASE, N), and its speed."""
    J[:] = 0.0
    for i in range(3):
        J[i, i], J[i, 3 + i], J[i, 6 + i], J[i, 9 + i] = 1.0, dt, 0.5 * dt * dt, -dt
        J[3 + i, 3 + i], J[3 + i, 6 + i] = 1.0, dt
    u, v = known[3] + dt * known[6], known[4] + dt * known[7]
    speed = np.sqrt(u * u + v * v)
    c, s = np.cos(known[NOSE]), np.sin(known[NOSE])  # one that hovers has its accelerations along its nose
    if speed > SLOW:
        c, s = u / speed, v / speed
    J[SIZE, LOG_SIZE] = np.exp(known[LOG_SIZE])
    J[A_LAT, 6], J[A_LAT, 7] = -s, c
    J[A_ALONG, 6], J[A_ALONG, 7] = c, s
    J[A_LONG, 8] = -1.0
    J[HEADING, NOSE] = J[BANK_ERROR, BANK] = 1.0


@njit((VECTOR, ROWS, NUMBER, VECTOR, VECTOR), cache=True, error_model="numpy")
def as_leader(known, C, dt, moved, v_F):
    """See `summary.as_leader`: mean (BASE,) and covariance (BASE, BASE), of a summary with mean `known` and
    covariance C."""
    x, P = np.zeros(BASE), np.zeros((BASE, BASE))
    J, JC = np.empty((BASE, N)), np.zeros((BASE, N))
    _derivatives(known, dt, J)
    width = JC.shape[1]
    for i in range(BASE):
        for k in range(N):
            x[i] += J[i, k] * known[k]
            if J[i, k] != 0.0:
                for j in range(width):
                    JC[i, j] += J[i, k] * C[k, j]
    for i in range(3):
        x[i] -= moved[i]
        x[3 + i] -= v_F[i]
    x[SIZE] = J[SIZE, LOG_SIZE]
    for i in range(BASE):
        for j in range(i + 1):
            for k in range(N):
                P[i, j] += JC[i, k] * J[j, k]
            P[j, i] = P[i, j]
    return x, P
