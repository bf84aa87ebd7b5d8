"""Ensemble Kalman filter (Evensen 1994): a sample of states represents mean and covariance.

    state = start(mean, covariance, members=40, seed=1)
    state = predict(state, process, Q, inflation=1.02)
    found = update(state, y, measure, R, angular)     # found.belief: an Ensemble again

It is for many states: where a covariance (n, n) is too large, some forty members are often enough. Its update is
the square root form of Whitaker & Hamill (2002), which adds no noise to the measurements. With more than 2 n
members the process noise is drawn with exactly the covariance Q and uncorrelated with the existing deviations
(second-order exact sampling, Pham 2001): on a linear model it is then the Kalman filter, to rounding. Fewer
members have too small a variance, and spurious correlations: `inflation` enlarges their deviations in each
prediction, and `taper` suppresses distant correlations in each update (Houtekamer & Mitchell 2001).

Random numbers are a function of the seed and of how often they were drawn: the same run gives the same bits.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside, check_spread
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, images_of, mask
from onboard.filters.belief import start as checked
from onboard.filters.errors import (
    INNOVATION_ERROR,
    MEASUREMENT_ERROR,
    FilterError,
    array_error,
    check_members,
    is_plain,
    shape_error,
)
from onboard.filters.gauss_hermite import centred, check_images
from onboard.filters.kernels import factors
from onboard.filters.kernels.calls import call, check_like
from onboard.filters.kernels.noise import noise_factor

DEFAULT_MEMBER_COUNT: Final = 50


class Ensemble(NamedTuple):
    """The state of an ensemble filter.

    Attributes
    ----------
    mean : (..., n)
        Mean of the members.
    deviations : (..., N, n)
        Each member's deviation from the mean.
    seed
        Seed of the random numbers.
    draws
        Number of earlier draws.
    """

    mean: Array
    deviations: Array
    seed: int
    draws: int


def start(mean: Array, covariance: Array, members: int = DEFAULT_MEMBER_COUNT, seed: int = 0) -> Ensemble:
    """Return an ensemble with this mean and covariance.

    The covariance is exact if the ensemble has more than n members.

    Parameters
    ----------
    mean : (..., n)
        Mean.
    covariance : (..., n, n)
        Covariance.
    members
        Number of members N.
    seed
        Seed of the random numbers.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    checked(mean, covariance)
    if members < 2:
        raise FilterError(f"members: must be at least 2, not {members}")
    (L,) = call(factors.factor, covariance=covariance)
    nothing = np.zeros((*mean.shape[:-1], members, 0))
    return Ensemble(mean, _drawn(nothing, mean.shape[-1], seed, 0) @ _t(L), seed, 1)


def predict(
    state: Ensemble, process: Rows, Q: Array, angular_states: Indices = (), inflation: float = 1.0
) -> Ensemble:
    """Time update.

    Parameters
    ----------
    process, Q, angular_states
        As in `unscented.predict`.
    inflation
        Factor on the deviations before the noise of Q is added.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, X = state.mean, state.deviations
    _check_spread(X, angular_states)
    images = images_of(process, mean[..., None, :] + X, None)
    check_images("process", images)
    check_like(_t(X[..., :1, :]) @ X[..., :1, :], Q=Q)
    mean, X = centred(images, _weights(X), angular_states)
    noise = _drawn(X, X.shape[-1], state.seed, state.draws) @ _t(noise_factor("Q", Q))
    return Ensemble(mean, inflation * X + noise, state.seed, state.draws + 1)


def update(
    state: Ensemble,
    y: Array,
    measure: Rows,
    R: Array,
    angular: Indices = (),
    angular_states: Indices = (),
    taper: tuple[Array, Array] | None = None,
) -> Update:
    """Measurement update.

    Parameters
    ----------
    y, measure, R, angular, angular_states
        As in `unscented.update`.
    taper
        Factors from 0 to 1 of the covariances of states with measured components (n, m), and of these with each
        other (m, m).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, X = state.mean, state.deviations
    if not is_plain(y) or y.dtype != np.float64 or y.shape[:-1] != mean.shape[:-1]:
        raise array_error(y=y, mean=mean)
    _check_spread(X, angular_states)
    images = images_of(measure, mean[..., None, :] + X, y)
    check_images("measure", images)
    check_members(~np.isfinite(y).all(axis=-1), MEASUREMENT_ERROR)
    mask(angular, y.shape[-1])
    predicted, Y = centred(images, _weights(X), angular)
    across, spread = (_t(A) @ Y / (X.shape[-2] - 1) for A in (X, Y))
    check_like(spread, R=R)
    root = noise_factor("R", R)
    if taper is not None:
        if (taper[0].shape, taper[1].shape) != (across.shape[-2:], spread.shape[-2:]):
            raise shape_error(taper_of_states=taper[0], taper_of_y=taper[1], covariance=across, R=R)
        across, spread = (A * np.asarray(t) for A, t in zip((across, spread), taper, strict=True))
    S = 0.5 * (spread + _t(spread)) + R
    (L,) = call(factors.factor, covariance=S)
    check_members((np.diagonal(L, axis1=-2, axis2=-1) <= 0).any(axis=-1), INNOVATION_ERROR)
    innovation = beside(y - predicted, np.zeros_like(y), angular)
    white, scaled = np.linalg.solve(L, innovation[..., None]), np.linalg.solve(L, _t(across))
    mean = mean + (_t(scaled) @ white)[..., 0]
    X = X - Y @ np.linalg.solve(_t(L + root), scaled)  # the gain of Andrews (1968), for any roots of S and R
    nis: Any = np.sum(white[..., 0] ** 2, axis=-1)
    after = Ensemble(mean, X, state.seed, state.draws)
    return Update(after, innovation, S, predicted, nis if np.ndim(nis) else float(nis))


def belief(state: Ensemble) -> Belief:
    """Return mean (..., n) and covariance (..., n, n) of an ensemble."""
    X = state.deviations
    P = _t(X) @ X / (X.shape[-2] - 1)
    return Belief(state.mean, 0.5 * (P + _t(P)))


def _drawn(X: Array, n: int, seed: int, draws: int) -> Array:
    """Return standard normal numbers (..., N, n) of mean zero.

    If N allows it, their sample covariance is the identity, and none of them is correlated with the columns of X
    (..., N, k).
    """
    count = X.shape[-2]
    rng = np.random.Generator(np.random.Philox(key=[seed, draws]))
    z = rng.standard_normal((*X.shape[:-1], n))
    z -= z.mean(axis=-2, keepdims=True)
    if count > X.shape[-1] + n:
        ones = np.ones((*X.shape[:-1], 1))
        basis = np.linalg.qr(np.concatenate([ones, X], axis=-1)).Q
        z -= basis @ (_t(basis) @ z)
        z = np.sqrt(count - 1) * np.linalg.qr(z).Q
    return z


def _check_spread(X: Array, angular_states: Indices) -> None:
    if angular_states:
        check_spread(np.concatenate([0 * X[..., :1, :], X], axis=-2), angular_states)


def _weights(X: Array) -> Array:
    return np.full(X.shape[-2], 1 / X.shape[-2])


def _t(A: Array) -> Array:
    return np.swapaxes(A, -1, -2)


METHODS: Final = (Method("ensemble", start, predict, update, belief),)
