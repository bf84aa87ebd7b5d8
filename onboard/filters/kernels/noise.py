"""The factor of a noise. Apart from `calls`, because few filters need these kernels."""

import numpy as np

from onboard.arrays import Array
from onboard.filters.errors import (
    Q_INDEFINITE,
    R_INDEFINITE,
    FilterError,
    NotPositiveDefiniteError,
    status_error,
)
from onboard.filters.kernels import factors
from onboard.filters.kernels.calls import call


def noise_factor(name: str, noise: Array) -> Array:
    """The lower factor (..., m, m) of a noise, "Q" or "R", which may be singular.

    Raises FilterError, NotPositiveDefiniteError, with the name.
    """
    if not np.isfinite(noise).all():
        raise FilterError(f"{name}: not finite")
    try:
        (lower,) = call(factors.factor, covariance=noise)
    except NotPositiveDefiniteError as error:
        raise status_error(Q_INDEFINITE if name == "Q" else R_INDEFINITE) from error
    return np.asarray(lower)
