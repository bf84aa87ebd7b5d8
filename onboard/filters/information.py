"""Information form of a Gaussian belief, in which sensors are fused by addition.

    prior = from_belief(belief)             # or nothing(n): nothing is known yet
    after = fuse(prior, first, second)      # each of them contribution(y, H, R), in any order, from anywhere
    belief = to_belief(after)

It is the Kalman filter's update, and costs one inverse of (n, n) for any number of measurements. It also allows a
start without a prior, and nodes that exchange contributions. A prediction is that of the belief. A nonlinear
measurement contributes by its line: with `H, value, rest = posterior_linearisation.regression(belief, measure,
weights, y)` that of y - value + H mean, with noise R + rest. Bar-Shalom, Li & Kirubarajan 2001, section 7.2.
"""

from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief
from onboard.filters.belief import start as checked
from onboard.filters.errors import FilterError, NotPositiveDefiniteError, require_plain

ROUNDING_TOLERANCE = 1e-12  # A smaller eigenvalue, relative to the largest, is rounding.


class Information(NamedTuple):
    """A belief in information form.

    Attributes
    ----------
    matrix : (..., n, n)
        Inverse of the covariance.
    vector : (..., n)
        `matrix` times the mean.
    """

    matrix: Array
    vector: Array


def nothing(n: int) -> Information:
    """Return the information before the first measurement: zero."""
    return Information(np.zeros((n, n)), np.zeros(n))


def contribution(y: Array, H: Array, R: Array) -> Information:
    """Return the information of a measurement: H^T R^-1 H and H^T R^-1 y.

    Parameters
    ----------
    y : (..., m)
        Measured values. Angles must be within pi of those of H x.
    H : (..., m, n)
        Measurement matrix.
    R : (..., m, m)
        Covariance of the noise, positive definite.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    require_plain(y=y, H=H, R=R)
    m = H.shape[-2] if H.ndim > 1 else 0
    if y.shape[-1:] != (m,) or R.shape[-2:] != (m, m):
        raise FilterError(f"shapes do not fit: y (m,), H (m, n), R (m, m) are {y.shape}, {H.shape}, {R.shape}")
    if not all(np.isfinite(array).all() for array in (y, H, R)):
        raise FilterError("y, H or R: not finite")
    inverse = _inverse("R: must be positive definite; a measurement without noise has no information form", R)
    weighed = np.swapaxes(H, -1, -2) @ inverse
    return Information(weighed @ H, (weighed @ y[..., None])[..., 0])


def fuse(*parts: Information) -> Information:
    """Return the sum of information from parts with independent errors.

    A leading axis of a part is kept: sum a batch of sensors with
    `Information(batch.matrix.sum(0), batch.vector.sum(0))`.
    """
    matrices, vectors = zip(*parts, strict=True)
    return Information(sum(matrices[1:], matrices[0]), sum(vectors[1:], vectors[0]))


def from_belief(belief: Belief) -> Information:
    """Return the information of a belief, mean (..., n) and covariance (..., n, n).

    Raises
    ------
    FilterError
        If an argument cannot be used.
    NotPositiveDefiniteError
        If a state is known exactly, which has no information form.
    """
    mean, covariance = checked(*belief)
    matrix = _inverse(
        "covariance: must be positive definite; a state known exactly has no information form", covariance
    )
    return Information(matrix, (matrix @ mean[..., None])[..., 0])


def to_belief(information: Information) -> Belief:
    """Return the mean and covariance of an information.

    Raises
    ------
    NotPositiveDefiniteError
        If a state, or a combination of states, has not been measured yet.
    """
    matrix, vector = information
    covariance = _inverse("information: leaves a state, or a combination of states, open", matrix)
    return Belief((covariance @ vector[..., None])[..., 0], covariance)


def _inverse(refusal: str, A: Array) -> Array:
    """Return the inverse of a positive definite matrix, symmetric to the last bit.

    The matrix is first scaled to a diagonal of ones.
    """
    diagonal = np.diagonal(A, axis1=-2, axis2=-1)
    if not np.all(diagonal > 0):
        raise NotPositiveDefiniteError(refusal)
    scale = 1 / np.sqrt(diagonal)
    each = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(A * each)
    if np.any(values[..., 0] <= ROUNDING_TOLERANCE * values[..., -1]):
        raise NotPositiveDefiniteError(refusal)
    inverse = each * (vectors / values[..., None, :] @ np.swapaxes(vectors, -1, -2))
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, -1, -2)))
