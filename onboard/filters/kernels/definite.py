"""Kernel of `filters.definite`."""

import numpy as np

from onboard.compiled import CONTRACTED, MAKING, kernel, signature
from onboard.filters.kernels.cholesky import factor_into


@kernel(signature(2), **MAKING, **CONTRACTED)
def factor(A):
    """Return (transposed Cholesky factor (n, n), whether there is one)."""
    lower_t = np.empty(A.shape)
    return lower_t, factor_into(A, lower_t)
