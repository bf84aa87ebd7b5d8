"""Compiled Cholesky factors, of positive definite and of singular matrices."""

import numpy as np

from onboard.compiled import CONTRACTED, FILLING, kernel


@kernel(**FILLING, **CONTRACTED)
def factor_into(A, lower_t):
    """Fill `lower_t` (n, n) with the transposed Cholesky factor of A (n, n).

    Row j is column j of the lower factor. Returns False if A is not positive definite or not finite. Only A's
    upper triangle is read.
    """
    n = A.shape[0]
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= lower_t[k, j] * lower_t[k, j]
        if not (pivot > 0.0 and pivot < np.inf):
            return False
        root = np.sqrt(pivot)
        inverse = root * (1.0 / pivot)  # this division does not wait for the root
        lower_t[j, j] = root
        for i in range(j + 1, n):  # sums in registers: half the time of subtracting row from row
            value = A[j, i]
            for k in range(j):
                value -= lower_t[k, i] * lower_t[k, j]
            lower_t[j, i] = value * inverse
            lower_t[i, j] = 0.0
    return True


@kernel(**FILLING)
def transposed_semifactor_into(A, upper):
    """Like `factor_into`, for the symmetric part of an A that may be singular.

    Returns False if it is indefinite or not finite. A pivot lost in rounding gives a row of zeros: process noise
    often has rank one.
    """
    n = A.shape[0]
    tolerance = 4 * n * np.finfo(np.float64).eps
    for j in range(n):
        for i in range(j, n):
            upper[j, i] = 0.5 * (A[i, j] + A[j, i])
        for k in range(j):
            entry = upper[k, j]
            for i in range(j, n):
                upper[j, i] -= entry * upper[k, i]
        pivot, allowed = upper[j, j], tolerance * abs(A[j, j])
        if not (pivot >= -allowed and pivot < np.inf):
            return False
        if pivot <= allowed:
            # Next to a zero pivot, a semi-definite matrix is zero; more than rounding is indefinite.
            for i in range(j + 1, n):
                if not upper[j, i] * upper[j, i] <= (allowed + tolerance * A[j, j]) * abs(A[i, i]):
                    return False
                upper[j, i] = upper[i, j] = 0.0
            upper[j, j] = 0.0
            continue
        root = np.sqrt(pivot)
        upper[j, j] = root
        for i in range(j + 1, n):
            upper[j, i] /= root
            upper[i, j] = 0.0
    return True


@kernel(**FILLING)
def semifactor_into(A, lower):
    """Fill the lower factor (n, n) of a covariance that may be singular.

    Returns False if it is indefinite or not finite.
    """
    if not transposed_semifactor_into(A, lower):
        return False
    for i in range(A.shape[0]):
        for j in range(i):
            lower[i, j] = lower[j, i]
            lower[j, i] = 0.0
    return True


@kernel(**FILLING)
def root_into(A, lower_t):
    """Like `factor_into`, but A may be singular: a state known exactly has a row of zeros.

    Most are positive definite, which costs no more than `factor_into`.
    """
    return factor_into(A, lower_t) or transposed_semifactor_into(A, lower_t)


@kernel(**FILLING)
def skip_known(lower_t):
    """Replace the zero pivots of `root_into` by infinity.

    Division by it gives an exactly known state no share, and so solves a consistent singular system.
    """
    for i in range(lower_t.shape[0]):
        if lower_t[i, i] == 0:
            lower_t[i, i] = np.inf


@kernel(**FILLING)
def clear_known(P):
    """Zero the covariances of exactly known states, whose variance is zero."""
    for i in range(P.shape[0]):
        if P[i, i] == 0:
            for j in range(P.shape[0]):
                P[i, j] = P[j, i] = 0.0


@kernel(**FILLING)
def is_noise(A, scratch):
    """Return whether a finite A (n, n) is the covariance of a noise, not indefinite; `scratch` is (n, n).

    A diagonal one costs almost nothing.
    """
    n, off = A.shape[0], False
    for i in range(n):
        if A[i, i] < 0:
            return False
        for j in range(i):
            off |= (A[i, j] != 0) | (A[j, i] != 0)
    return not off or root_into(A, scratch)
