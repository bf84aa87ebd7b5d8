"""The information form of a Gaussian belief (Bar-Shalom, Li & Kirubarajan 2001, section 7.2): many sensors are
fused by adding what each contributes.

    prior = from_belief(belief)             # or nothing(n): nothing is known yet
    after = fuse(prior, first, second)      # each of them contribution(y, H, R), in any order, from anywhere
    belief = to_belief(after)

It is the Kalman filter's update, and costs one inverse of (n, n) however much is measured. What it brings beside
is a start without a prior, and nodes that exchange contributions. A prediction is that of the belief. A
nonlinear measurement contributes by its line: with `H, value, rest = posterior_linearisation.regression(belief,
measure, weights, y)` that of y - value + H mean, with noise R + rest.
"""

from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief
from onboard.filters.belief import start as checked
from onboard.filters.errors import FilterError, NotPositiveDefiniteError, require_plain

DIGITS = 1e-12  # relative: below it an eigenvalue is rounding


class Information(NamedTuple):
    """`matrix` (..., n, n), the inverse of a covariance, and `vector` (..., n), that matrix times the mean."""

    matrix: Array
    vector: Array


def nothing(n: int) -> Information:
    """What is known before the first measurement."""
    return Information(np.zeros((n, n)), np.zeros(n))


def contribution(y: Array, H: Array, R: Array) -> Information:
    """What a measurement y (..., m) of H x (..., m, n), with noise R (..., m, m), tells of x: H^T R^-1 H and
    H^T R^-1 y. Angles of y must be beside those of H x.

    Raises FilterError, NotPositiveDefiniteError: R must be positive definite.
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
    """The sum of what is known, of parts whose errors are independent. A leading axis of a part is kept: sum a
    batch of sensors with `Information(batch.matrix.sum(0), batch.vector.sum(0))`."""
    matrices, vectors = zip(*parts, strict=True)
    return Information(sum(matrices[1:], matrices[0]), sum(vectors[1:], vectors[0]))


def from_belief(belief: Belief) -> Information:
    """What a belief, mean (..., n) and covariance (..., n, n), knows.

    Raises FilterError, NotPositiveDefiniteError: what is known exactly has no information form.
    """
    mean, covariance = checked(*belief)
    matrix = _inverse(
        "covariance: must be positive definite; a state known exactly has no information form", covariance
    )
    return Information(matrix, (matrix @ mean[..., None])[..., 0])


def to_belief(information: Information) -> Belief:
    """The mean and covariance of what is known.

    Raises NotPositiveDefiniteError where a state, or a combination of states, has not been measured yet.
    """
    matrix, vector = information
    covariance = _inverse("information: leaves a state, or a combination of states, open", matrix)
    return Belief((covariance @ vector[..., None])[..., 0], covariance)


def _inverse(refusal: str, A: Array) -> Array:
    """Of a positive definite matrix, scaled to a diagonal of ones; symmetric to the last bit."""
    diagonal = np.diagonal(A, axis1=-2, axis2=-1)
    if not np.all(diagonal > 0):
        raise NotPositiveDefiniteError(refusal)
    scale = 1 / np.sqrt(diagonal)
    each = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(A * each)
    if np.any(values[..., 0] <= DIGITS * values[..., -1]):
        raise NotPositiveDefiniteError(refusal)
    inverse = each * (vectors / values[..., None, :] @ np.swapaxes(vectors, -1, -2))
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, -1, -2)), A.dtype)
