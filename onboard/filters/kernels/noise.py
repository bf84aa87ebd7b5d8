"""The factor of a noise, apart from `calls`, because few filters need these kernels."""

import numpy as np

from onboard.arrays import Array
from onboard.filters.errors import (
    Q_INDEFINITE_ERROR,
    R_INDEFINITE_ERROR,
    FilterError,
    NotPositiveDefiniteError,
    status_error,
)
from onboard.filters.kernels import factors
from onboard.filters.kernels.calls import call


def noise_factor(name: str, noise: Array) -> Array:
    """Return the lower factor (..., m, m) of a noise, "Q" or "R", which may be singular.

    Raises FilterError, NotPositiveDefiniteError, with the name.
    """
    if not np.isfinite(noise).all():
        raise FilterError(f"{name}: not finite")
    try:
        (lower,) = call(factors.factor, covariance=noise)
    except NotPositiveDefiniteError as error:
        raise status_error(Q_INDEFINITE_ERROR if name == "Q" else R_INDEFINITE_ERROR) from error
    return np.asarray(lower)
