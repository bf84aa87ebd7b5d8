"""Cholesky factor of a covariance, in a module of its own.

A program that needs nothing else of the filters loads nothing else: with the other kernels, a flight took 36 MB
more.
"""

from onboard.arrays import Array
from onboard.filters.errors import NotPositiveDefiniteError, array_error
from onboard.filters.kernels import definite as kernels


def factor(covariance: Array) -> Array:
    """Return the lower Cholesky factor (n, n) of a covariance.

    Raises
    ------
    NotPositiveDefiniteError
        If there is none, also for NaN and infinity, which LAPACK accepts.
    """
    try:
        upper, exists = kernels.factor(covariance)
    except TypeError as error:
        raise array_error(covariance=covariance) from error
    if not exists:
        raise NotPositiveDefiniteError("covariance: not positive definite")
    return upper.T  # type: ignore[no-any-return]  # Numba's functions are not typed
