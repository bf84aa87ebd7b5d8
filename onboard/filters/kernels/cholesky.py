"""Compiled Cholesky factors, of positive definite and of singular matrices."""

import numpy as np
from numba import njit

from onboard.filters.compiled import CONTRACTED, FILLING


@njit(**FILLING, **CONTRACTED)
def factor_into(A, lower_t):  # type: ignore[no-untyped-def]
    """Cholesky factor of A (n, n), transposed, into `lower_t` (n, n): row j is column j of the lower factor.
    False if A is not positive definite or not finite. Only A's upper triangle is read."""
    n = A.shape[0]
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= lower_t[k, j] * lower_t[k, j]
        if not (pivot > 0.0 and pivot < np.inf):
            return False
        root = np.sqrt(pivot)
        inverse = root * (1.0 / pivot)  # a division that need not wait for the root
        lower_t[j, j] = root
        for i in range(j + 1, n):  # sums in registers: half the time of subtracting row from row
            value = A[j, i]
            for k in range(j):
                value -= lower_t[k, i] * lower_t[k, j]
            lower_t[j, i] = value * inverse
            lower_t[i, j] = 0.0
    return True


@njit(**FILLING)
def semifactor_into(A, lower):  # type: ignore[no-untyped-def]
    """Cholesky factor (n, n) of the symmetric part of A, which may be singular; False if it is indefinite or not
    finite. A pivot lost in rounding gives a column of zeros: process noise often has rank one."""
    n = A.shape[0]
    tolerance = A.dtype.type(4 * n) * np.finfo(A.dtype).eps
    half = A.dtype.type(0.5)
    upper = lower  # at first its transpose, row by row along memory
    for j in range(n):
        for i in range(j, n):
            upper[j, i] = half * (A[i, j] + A[j, i])
        for k in range(j):
            entry = upper[k, j]
            for i in range(j, n):
                upper[j, i] -= entry * upper[k, i]
        pivot, allowed = upper[j, j], tolerance * abs(A[j, j])
        if not (pivot >= -allowed and pivot < np.inf):
            return False
        if pivot <= allowed:
            # what is left of a semi-definite matrix beside a zero pivot is zero; more than rounding is indefinite
            for i in range(j + 1, n):
                if not upper[j, i] * upper[j, i] <= (allowed + tolerance * A[j, j]) * abs(A[i, i]):
                    return False
                upper[j, i] = 0.0
            upper[j, j] = 0.0
            continue
        root = np.sqrt(pivot)
        upper[j, j] = root
        for i in range(j + 1, n):
            upper[j, i] /= root
    for i in range(n):
        for j in range(i):
            lower[i, j] = upper[j, i]
            upper[j, i] = 0.0
    return True


@njit(**FILLING)
def is_semidefinite(A, scratch):  # type: ignore[no-untyped-def]
    """Whether a symmetric A (n, n) is finite and not indefinite; `scratch` is (n, n). Most are positive definite,
    which is the cheaper test."""
    return factor_into(A, scratch) or semifactor_into(A, scratch)
