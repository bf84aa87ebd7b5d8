"""Gauss-Hermite Kalman filter (Ito & Xiong 2000).

The moments are by a product rule of `order` points an axis. With order p a polynomial of degree 2p - 1 in each
state is averaged exactly. It takes p^n points: with order 3, 81 for four states and 19,683 for nine. All weights
are positive. Batches as in `unscented`.
"""

from functools import lru_cache
from itertools import product
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import kalman
from onboard.filters.angles import beside, check_spread
from onboard.filters.belief import Belief, Method, Rows, Update, images_of, mask, start
from onboard.filters.errors import (
    ANGLE_ERROR,
    IMAGES_ERROR,
    MAX_ANGLE_SPREAD,
    POINTS_ERROR,
    FilterError,
    check_members,
)
from onboard.filters.kernels import factors
from onboard.filters.kernels.calls import call, check_like
from onboard.filters.kernels.noise import noise_factor

MAX_GRID_SIZE: Final = 1_000_000
DEFAULT_ORDER: Final = 3


@lru_cache(maxsize=32)
def rule(n: int, order: int = DEFAULT_ORDER) -> tuple[Array, Array]:
    """Return points (order^n, n) of a standard Gaussian, and their weights (order^n,).

    They are read-only.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if order < 2 or order**n > MAX_GRID_SIZE:
        raise FilterError(f"order: must be at least 2, with order^n at most {MAX_GRID_SIZE:,}, not {order}^{n}")
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    points = np.array(list(product(nodes, repeat=n)))
    each = np.prod(np.array(list(product(weights / weights.sum(), repeat=n))), axis=1)
    for array in (points, each):
        array.flags.writeable = False
    return points, each


def predict(
    belief: Belief, process: Rows, Q: Array, order: int = DEFAULT_ORDER, angular_states: tuple[int, ...] = ()
) -> Belief:
    """Time update.

    Parameters
    ----------
    belief, process, Q, angular_states
        As in `unscented.predict`.
    order
        Number of points on each axis.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    points, weights, _, _ = _drawn(belief, order, angular_states)
    images = images_of(process, points, None)
    check_images("process", images)
    check_like(belief.covariance, Q=Q)
    noise_factor("Q", Q)
    mean, off = centred(images, weights, angular_states)
    spread = np.swapaxes(off, -1, -2) @ (weights[:, None] * off)
    return Belief(mean, 0.5 * (spread + np.swapaxes(spread, -1, -2)) + Q)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    order: int = DEFAULT_ORDER,
    angular_states: tuple[int, ...] = (),
) -> Update:
    """Measurement update in Joseph's form, with the best line through the points' images.

    Parameters
    ----------
    belief, y, measure, R, angular, considered, angular_states
        As in `unscented.update`.
    order
        Number of points on each axis.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    points, weights, L, z = _drawn(belief, order, angular_states)
    images = images_of(measure, points, y)
    check_images("measure", images)
    predicted, off = centred(images, weights, angular)
    scaled = np.swapaxes(off, -1, -2) @ (weights[:, None] * z)  # the line, over the factor
    known = np.diagonal(L, axis1=-2, axis2=-1) == 0  # the images do not depend on this z
    L = L + known[..., None] * np.eye(L.shape[-1])
    slope = np.swapaxes(np.linalg.solve(np.swapaxes(L, -1, -2), np.swapaxes(scaled, -1, -2)), -1, -2)
    rest = off - z @ np.swapaxes(scaled, -1, -2)
    noise = np.swapaxes(rest, -1, -2) @ (weights[:, None] * rest)
    check_like(noise, R=R)
    noise_factor("R", R)
    return kalman.correct(belief, y, predicted, slope, R + noise, considered, angular)


def _drawn(belief: Belief, order: int, angular_states: tuple[int, ...]) -> tuple[Array, Array, Any, Array]:
    """Return points (..., k, n), their weights (k,), the factor, and the standard points.

    The factor is (..., n, n), the standard points are (k, n).
    """
    mean, covariance = start(*belief)
    z, weights = rule(mean.shape[-1], order)
    (L,) = call(factors.factor, covariance=covariance)
    offsets = z @ np.swapaxes(L, -1, -2)
    if angular_states:
        check_spread(np.concatenate([0 * offsets[..., :1, :], offsets], axis=-2), angular_states)
    return mean[..., None, :] + offsets, weights, L, z


def centred(images: Array, weights: Array, angular: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the mean (..., m) of images (..., k, m), and their deviations.

    Angles are averaged about the middle image, which is the mean's or near it. Raises FilterError for an angle
    that is more than 2 rad from it.
    """
    middle = images[..., images.shape[-2] // 2, :]
    off = images - middle[..., None, :]
    if angular:
        angles = mask(angular, off.shape[-1])
        off = beside(off, np.zeros_like(off), angular)
        check_members((np.abs(off) > MAX_ANGLE_SPREAD)[..., angles].any(axis=(-2, -1)), ANGLE_ERROR)
    shift = weights @ off
    return middle + shift, off - shift[..., None, :]


def check_images(name: str, images: Array) -> None:
    """Check that all images (..., k, m) of "process" or "measure" are finite.

    Raises FilterError.
    """
    check_members(~np.isfinite(images).all(axis=(-1, -2)), POINTS_ERROR if name == "process" else IMAGES_ERROR)


METHODS: Final = (
    Method(
        "gauss-hermite",
        start,
        lambda state, process, Q, angular_states=(): predict(state, process, Q, DEFAULT_ORDER, angular_states),
        lambda state, y, measure, R, angular=(), angular_states=(): update(
            state, y, measure, R, angular, angular_states=angular_states
        ),
        lambda belief: belief,
    ),
)
