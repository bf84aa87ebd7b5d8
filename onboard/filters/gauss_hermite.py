"""The Gauss-Hermite Kalman filter (Ito & Xiong 2000): the moments by a product rule of `order` points an axis.

With order p a polynomial of degree 2p - 1 in each state is averaged exactly; that takes p^n points, 81 for four
states and 19,683 for nine with order 3. All weights are positive. Batches and precisions as in `unscented`.
"""

from functools import lru_cache
from itertools import product
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import kalman
from onboard.filters.angles import beside, check_spread
from onboard.filters.belief import Belief, Method, Rows, Update, images_of, mask, start
from onboard.filters.errors import ANGLE, FARTHEST, IMAGES, POINTS, FilterError, check_members
from onboard.filters.kernels import factors
from onboard.filters.kernels.calls import call, check_like
from onboard.filters.kernels.noise import noise_factor

MOST: Final = 1_000_000  # points
ORDER: Final = 3


@lru_cache(maxsize=32)
def rule(n: int, order: int = ORDER) -> tuple[Array, Array]:
    """Points (order^n, n) of a standard Gaussian, and their weights (order^n,). Read-only.

    Raises FilterError.
    """
    if order < 2 or order**n > MOST:
        raise FilterError(f"order: must be at least 2, with order^n at most {MOST:,}, not {order}^{n}")
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    points = np.array(list(product(nodes, repeat=n)))
    each = np.prod(np.array(list(product(weights / weights.sum(), repeat=n))), axis=1)
    for array in (points, each):
        array.flags.writeable = False
    return points, each


def predict(
    belief: Belief, process: Rows, Q: Array, order: int = ORDER, angular_states: tuple[int, ...] = ()
) -> Belief:
    """Time update; `process` maps rows (k, n) -> (k, n), Q (..., n, n), `angular_states` as in `angles`.

    Raises FilterError, NotPositiveDefiniteError.
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
    order: int = ORDER,
    angular_states: tuple[int, ...] = (),
) -> Update:
    """Measurement update in Joseph's form, with the best line through the points' images; arguments as in
    `unscented.update`.

    Raises FilterError, NotPositiveDefiniteError.
    """
    points, weights, L, z = _drawn(belief, order, angular_states)
    images = images_of(measure, points, y)
    check_images("measure", images)
    predicted, off = centred(images, weights, angular)
    scaled = np.swapaxes(off, -1, -2) @ (weights[:, None] * z)  # the line, over the factor
    known = np.diagonal(L, axis1=-2, axis2=-1) == 0  # of which the images do not depend on z
    L = L + known[..., None] * np.eye(L.shape[-1], dtype=L.dtype)
    slope = np.swapaxes(np.linalg.solve(np.swapaxes(L, -1, -2), np.swapaxes(scaled, -1, -2)), -1, -2)
    rest = off - z @ np.swapaxes(scaled, -1, -2)
    noise = np.swapaxes(rest, -1, -2) @ (weights[:, None] * rest)
    check_like(noise, R=R)
    noise_factor("R", R)
    return kalman.correct(belief, y, predicted, slope, R + noise, considered, angular)


def _drawn(belief: Belief, order: int, angular_states: tuple[int, ...]) -> tuple[Array, Array, Any, Array]:
    """Points (..., k, n), their weights (k,), the factor (..., n, n), and the standard points (k, n)."""
    mean, covariance = start(*belief)
    z, weights = (array.astype(mean.dtype) for array in rule(mean.shape[-1], order))
    (L,) = call(factors.factor, covariance=covariance)
    offsets = z @ np.swapaxes(L, -1, -2)
    if angular_states:
        check_spread(np.concatenate([0 * offsets[..., :1, :], offsets], axis=-2), angular_states)
    return mean[..., None, :] + offsets, weights, L, z


def centred(images: Array, weights: Array, angular: tuple[int, ...]) -> tuple[Array, Array]:
    """The mean (..., m) of images (..., k, m), and their deviations. Angles are averaged about the middle image,
    which is the mean's or beside it.

    Raises FilterError for an angle that is more than 2 rad from it."""
    middle = images[..., images.shape[-2] // 2, :]
    off = images - middle[..., None, :]
    if angular:
        angles = mask(angular, off.shape[-1])
        off = beside(off, np.zeros_like(off), angular)
        check_members((np.abs(off) > FARTHEST)[..., angles].any(axis=(-2, -1)), ANGLE)
    shift = weights @ off
    return middle + shift, off - shift[..., None, :]


def check_images(name: str, images: Array) -> None:
    """Check that all images (..., k, m) of "process" or "measure" are finite. Raises FilterError."""
    check_members(~np.isfinite(images).all(axis=(-1, -2)), POINTS if name == "process" else IMAGES)


METHODS: Final = (
    Method(
        "gauss-hermite",
        start,
        lambda state, process, Q, angular_states=(): predict(state, process, Q, ORDER, angular_states),
        lambda state, y, measure, R, angular=(), angular_states=(): update(
            state, y, measure, R, angular, angular_states=angular_states
        ),
        lambda belief: belief,
    ),
)
