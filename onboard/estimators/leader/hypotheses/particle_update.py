"""The update of one particle's Gaussian by an image: what `wing` and `points` share.

The state is that of `wing`, of which an image has at most one bias. No image shows the downward velocity,
and the level one only where the nose is tied to the course.
"""

from typing import Final

import numpy as np
from numba import njit

from onboard.filters.compiled import MAKING

TINY: Final = 1e-12
NO_OTHERS: Final = np.empty((0, 0))
TAILS: Final = 4.0  # degrees of freedom of Student's t; what a leader does is no Gaussian
CONSIDERED: Final = 13  # the first component of a state that images do not estimate


@njit(**MAKING)
def factor(R):
    """The lower Cholesky factor of the measurement's noise (m, m)."""
    m = R.shape[0]
    L = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            total = R[i, j]
            for n in range(j):
                total -= L[i, n] * L[j, n]
            L[i, j] = np.sqrt(max(total, TINY * TINY)) if i == j else total / L[j, j]
    return L


@njit(**MAKING)
def whiten(L, e, J):
    """Innovation and derivatives in units of the noise with factor L, in place."""
    width = J.shape[1]  # as in `correct`
    for i in range(e.shape[0]):
        for j in range(i):
            share = L[i, j]
            e[i] -= share * e[j]
            for n in range(width):
                J[i, n] -= share * J[j, n]
        scale = 1.0 / L[i, i]
        e[i] *= scale
        for n in range(width):
            J[i, n] *= scale


@njit(**MAKING)
def dot(a, b):
    """The product of two state vectors (N or more,), one of which has no downward velocity: no image shows one."""
    middle = a[6] * b[6] + a[7] * b[7] + a[8] * b[8] + a[13] * b[13]
    rest = (a[9] * b[9] + a[10] * b[10]) + (a[11] * b[11] + a[12] * b[12])
    return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) + middle + rest + (a[3] * b[3] + a[4] * b[4])


@njit(**MAKING)
def project(w, P, c):
    """The product of a row of derivatives w (width,), none by the downward velocity, and a covariance
    (width, width), into c (width,)."""
    for n in range(P.shape[1]):
        near = w[0] * P[0, n] + w[1] * P[1, n] + w[2] * P[2, n]
        middle = w[6] * P[6, n] + w[7] * P[7, n] + w[8] * P[8, n] + w[13] * P[13, n]
        far = (w[9] * P[9, n] + w[10] * P[10, n]) + (w[11] * P[11, n] + w[12] * P[12, n])
        c[n] = near + middle + far + (w[3] * P[3, n] + w[4] * P[4, n])


@njit(**MAKING)
def log_likelihood(nis, m, det):
    """The logarithm of the likelihood of m components, without their common constant, by Student's t in place of a
    Gaussian (Roth, Ozkan and Gustafsson, 2013): one image that fits no hypothesis decides little between them."""
    return -0.5 * ((TAILS + m) * np.log1p(nis / TAILS) + np.log(det))


@njit(**MAKING)
def correct(x, P, e, J, c, dx, bias):
    """Mean and covariance of one particle by one whitened component after another, in place. The NIS, and the
    determinant of the innovation's covariance over that of the noise. J (m, W) has no derivatives by the
    downward velocity, and by biases at most one, in the column `bias` (0: by none).

    Size and biases are considered and not estimated (Schmidt, 1966): images show the size over the range, and what
    little our own motion says of it, the model's errors outweigh.

    The compiler vectorises the loops over a row because it does not know their length: it would write loops of N
    out, number by number, which takes twice as long."""
    width = P.shape[1]
    nis, det = 0.0, 1.0
    size = P[CONSIDERED, CONSIDERED]
    others = P[CONSIDERED:, CONSIDERED:].copy() if width > CONSIDERED + 1 else NO_OTHERS
    dx[:] = 0.0
    for j in range(e.shape[0]):
        w = J[j]
        project(w, P, c)
        s, r = 1.0 + dot(w, c), e[j] - dot(w, dx)
        if bias > 0:
            for n in range(width):
                c[n] += w[bias] * P[bias, n]
            s, r = 1.0 + dot(w, c) + w[bias] * c[bias], r - w[bias] * dx[bias]
        s = max(s, TINY)
        nis += r * r / s
        det *= s
        g = 1.0 / s
        for i in range(width):
            dx[i] += c[i] * (r * g)
            share = c[i] * g
            for n in range(width):
                P[i, n] -= share * c[n]
    P[CONSIDERED, CONSIDERED] = size
    if width > CONSIDERED + 1:
        P[CONSIDERED:, CONSIDERED:] = others
    for n in range(CONSIDERED):
        x[n] += dx[n]
    return nis, det
