"""The Gaussian of one particle, corrected by rows of a view.

The covariance of a row with the state, and a Schmidt update. The state is that of `motion`, with at most one bias.
"""

import numpy as np

from onboard.compiled import FILLING, kernel
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.hypotheses.motion import (
    AX,
    AY,
    AZ,
    BANK_ERROR,
    LOG_SIZE,
    RX,
    RY,
    RZ,
    TILT_EAST,
    TILT_NORTH,
    VX,
    VY,
    WING_SCALE_ERROR,
)


@kernel(**FILLING)
def factor(S):
    """The lower Cholesky factor of a covariance (m, m), in place.

    Above the diagonal, S stays as it is."""
    for i in range(S.shape[0]):
        for j in range(i + 1):
            total = S[i, j]
            for n in range(j):
                total -= S[i, n] * S[j, n]
            S[i, j] = np.sqrt(max(total, given.MIN_DEVIATION * given.MIN_DEVIATION)) if i == j else total / S[j, j]


@kernel(**FILLING)
def normalised_squared(e, S):
    """The square of an error e (m,) in units of its covariance S (m, m). Both are overwritten."""
    found = 0.0
    factor(S)
    for i in range(e.shape[0]):
        for j in range(i):
            e[i] -= S[i, j] * e[j]
        e[i] /= S[i, i]
        found += e[i] * e[i]
    return found


@kernel(**FILLING)
def dot(a, b, bias):
    """The product of two state vectors (W,), one of which has no downward velocity, which no image shows, and of
    the biases at most that in the column `bias` (0: none)."""
    middle = a[AX] * b[AX] + a[AY] * b[AY] + a[AZ] * b[AZ] + a[LOG_SIZE] * b[LOG_SIZE]
    rest = (a[BANK_ERROR] * b[BANK_ERROR] + a[TILT_NORTH] * b[TILT_NORTH]) + (
        a[TILT_EAST] * b[TILT_EAST] + a[WING_SCALE_ERROR] * b[WING_SCALE_ERROR]
    )
    found = (a[RX] * b[RX] + a[RY] * b[RY] + a[RZ] * b[RZ]) + middle + rest + (a[VX] * b[VX] + a[VY] * b[VY])
    return found + a[bias] * b[bias] if bias > 0 else found


@kernel(**FILLING)
def project(w, P, bias, c):
    """The product of a row of derivatives w (W,) as in `dot`, and a covariance (W, W), into c (W,)."""
    for n in range(P.shape[1]):
        near = w[RX] * P[RX, n] + w[RY] * P[RY, n] + w[RZ] * P[RZ, n]
        middle = w[AX] * P[AX, n] + w[AY] * P[AY, n] + w[AZ] * P[AZ, n] + w[LOG_SIZE] * P[LOG_SIZE, n]
        far = (w[BANK_ERROR] * P[BANK_ERROR, n] + w[TILT_NORTH] * P[TILT_NORTH, n]) + (
            w[TILT_EAST] * P[TILT_EAST, n] + w[WING_SCALE_ERROR] * P[WING_SCALE_ERROR, n]
        )
        c[n] = near + middle + far + (w[VX] * P[VX, n] + w[VY] * P[VY, n])
    if bias > 0:
        for n in range(P.shape[1]):
            c[n] += w[bias] * P[bias, n]


@kernel(**FILLING)
def correct(x, P, e, C, S, dx):
    """Mean and covariance of one particle by an innovation e (m,), m even, of covariance S (m, m) and covariance C
    (m, W) with the state, in place, and the change of the mean into dx (W,). The NIS, and the logarithm of the
    determinant of S. All arguments are overwritten.

    Size and biases are considered and not estimated (Schmidt, 1966): images show the size over the range, and what
    little our own motion says of it, the model's errors outweigh.

    The compiler vectorises the loops over a row because it does not know their length: it would write loops of N
    out, number by number, which takes twice as long."""
    m, width, nis, log_det = e.shape[0], P.shape[1], 0.0, 0.0
    factor(S)
    for n in range(width):
        dx[n] = 0.0
    for i in range(m):
        row = C[i]
        for j in range(i):
            share, other = S[i, j], C[j]
            e[i] -= share * e[j]
            for n in range(width):
                row[n] -= share * other[n]
        scale = 1.0 / S[i, i]
        e[i] *= scale
        for n in range(width):
            row[n] *= scale
            dx[n] += e[i] * row[n]
        nis += e[i] * e[i]
        log_det += 2.0 * np.log(S[i, i])
    for j in range(0, m, 2):  # two at once: half as many passes over P
        a, b = C[j], C[j + 1]
        for i in range(width):
            row, first, second = P[i], a[i], b[i]
            for n in range(width if i < LOG_SIZE else LOG_SIZE):
                row[n] -= first * a[n] + second * b[n]
    for n in range(LOG_SIZE):
        x[n] += dx[n]
    return nis, log_det
