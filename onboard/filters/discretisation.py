"""From continuous to discrete time: transition and process noise of a linear model over a step, and RK4.

    F, Q = van_loan(A, W, dt)                     # any linear model
    F, Q = wiener_acceleration(dt, q)             # the closed forms of kinematic ones
    rows = rk4(derivative, rows, dt)              # a nonlinear model

`dt` may be an array (...,): the matrices then are (..., n, n).
"""

from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Rows
from onboard.filters.errors import FilterError

TERMS: Final = 14  # of the series at a norm of 1/4: the first left out is below 1e-19


class Discrete(NamedTuple):
    """x' = F x + noise of covariance Q, both (..., n, n)."""

    F: Array
    Q: Array


def van_loan(A: Array, W: Array, dt: Any) -> Discrete:
    """The discrete model of x_dot = A x + white noise of spectral density W over `dt` seconds: F = exp(A dt),
    and Q, the integral of exp(A s) W exp(A s)^T over the step, for A and W (..., n, n). For noise through L, W
    = L Qc L^T.

    Van Loan (1978) and the matrix fraction of Lazarov et al. (eqs 4-7) take both from one exponential of
    [[-A, W], [0, A^T]]. That needs exp(-A dt), which overflows or cancels where A decays fast. Here Q is a sum of
    terms that do not cancel: a series for a short step, doubled by Q(2h) = Q(h) + F(h) Q(h) F(h)^T.

    Raises FilterError.
    """
    step = _positive(dt)
    A, W = np.asarray(A, float), np.asarray(W, float)
    if A.ndim < 2 or A.shape[-1] != A.shape[-2] or W.shape[-2:] != A.shape[-2:]:
        raise FilterError(f"A, W: must be square and of one size, not {A.shape} and {W.shape}")
    if not (np.isfinite(A).all() and np.isfinite(W).all()):
        raise FilterError("A, W: not finite")
    norm = float(np.max(np.sum(np.abs(A), axis=-1) * step[..., None], initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(4 * norm)))) if norm > 0 else 0
    h = (step / 2**halvings)[..., None, None]
    F, Q = _series(A * h, W * h)
    for _ in range(halvings):
        Q = Q + F @ Q @ np.swapaxes(F, -1, -2)
        F = F @ F
    return Discrete(F, 0.5 * (Q + np.swapaxes(Q, -1, -2)))


def _series(Ah: Array, Wh: Array) -> tuple[Array, Array]:
    """exp(Ah), and the sum of T_k / k with T_1 = Wh and T_k+1 = (Ah T_k + T_k Ah^T) / k: the integral of their
    derivative Q' = A Q + Q A^T + W."""
    F = np.eye(Ah.shape[-1]) + Ah
    Q = term = np.broadcast_to(Wh, np.broadcast_shapes(Ah.shape, Wh.shape))
    power = Ah
    for k in range(2, TERMS + 1):
        power = Ah @ power / k
        half = Ah @ term / k
        term = half + np.swapaxes(half, -1, -2)
        F, Q = F + power, Q + term
    return F, Q


def wiener_acceleration(dt: Any, q: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """The continuous Wiener process acceleration model: white jerk of density `q`, one number or one for each
    axis. States are ordered [positions, velocities, accelerations], or `by_axis` [x, vx, ax, y, ...].

    Erratum: eq 14 of Lazarov et al. is indefinite. An axis has q [[t^5/20, t^4/8, t^3/6], [., t^3/3, t^2/2],
    [., ., t]].

    Raises FilterError.
    """
    return _kinematic(3, dt, q, axes, by_axis)


def white_acceleration(dt: Any, q: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """The continuous white noise acceleration model: constant velocity but for white acceleration of density
    `q`. An axis has q [[t^3/3, t^2/2], [., t]]. Otherwise as `wiener_acceleration`.

    Raises FilterError.
    """
    return _kinematic(2, dt, q, axes, by_axis)


def _kinematic(order: int, dt: Any, q: Any, axes: int, by_axis: bool) -> Discrete:
    """`order` integrations of white noise on each axis: F_ij = t^(j-i) / (j-i)!, and Q = q t^(a+b+1) / (a! b!
    (a+b+1)) where a and b integrations lie between the two states and the noise."""
    t = _positive(dt)[..., None, None]
    density = np.asarray(q, float)
    if density.shape not in {(), (axes,)} or not (np.isfinite(density) & (density >= 0)).all():
        raise FilterError(f"q: must be one number, or one for each of {axes} axes, finite and not negative")
    factorial = np.array([1.0, 1.0, 2.0])
    i = np.arange(order)
    ahead = np.maximum(i[None, :] - i[:, None], 0)
    F = np.triu(t**ahead / factorial[ahead])
    a, b = order - 1 - i[:, None], order - 1 - i[None, :]
    Q = t ** (a + b + 1) / (factorial[a] * factorial[b] * (a + b + 1))
    each, noise = np.eye(axes), np.diag(np.broadcast_to(density, axes))
    return Discrete(_kron(each, F), _kron(noise, Q)) if by_axis else Discrete(_kron(F, each), _kron(Q, noise))


def _kron(a: Array, b: Array) -> Array:
    """The Kronecker product of matrices, either of which may be a batch."""
    product = np.einsum("...ij,...kl->...ikjl", a, b)
    return np.asarray(product).reshape(*product.shape[:-4], a.shape[-2] * b.shape[-2], a.shape[-1] * b.shape[-1])


def rk4(derivative: Rows, rows: Array, dt: float) -> Array:
    """Rows (k, n) after `dt` seconds of x_dot = derivative(x), a function over rows: one step of classical
    Runge-Kutta. Its precision is the rows'.

    Raises FilterError.
    """
    h = float(_positive(dt))
    k1 = derivative(rows)
    if k1.shape != rows.shape:
        raise FilterError(f"derivative: gave {k1.shape} for rows {rows.shape}")
    k2 = derivative(rows + (0.5 * h) * k1)
    k3 = derivative(rows + (0.5 * h) * k2)
    k4 = derivative(rows + h * k3)
    return rows + (h / 6) * (k1 + 2 * k2 + 2 * k3 + k4)


def _positive(dt: Any) -> Array:
    """`dt` as an array. Raises FilterError."""
    step = np.asarray(dt, float)
    if not (np.isfinite(step) & (step > 0)).all():
        raise FilterError(f"dt: must be positive and finite, not {dt}")
    return step


def discrete_white_acceleration(dt: Any, variance: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """The discrete white noise acceleration model: an acceleration of `variance`, (m/s^2)^2, one number or one
    for each axis, that is constant over a step and independent of all others. An axis has variance times
    [[t^4/4, t^3/2], [., t^2]], of rank one. Otherwise as `white_acceleration`.

    Raises FilterError.
    """
    F = white_acceleration(dt, 1.0, axes, by_axis).F
    t = _positive(dt)
    G = np.stack([0.5 * t * t, t], axis=-1)
    return Discrete(F, _of_axes(G[..., :, None] * G[..., None, :], variance, axes, by_axis))


def singer(dt: Any, tau: float, variance: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """The model of a manoeuvring target by Singer (1970): an acceleration of `variance`, (m/s^2)^2, one number
    or one for each axis, whose correlation fades as exp(-t / tau), tau in seconds. States as of
    `wiener_acceleration`, which it is for tau much longer than the step; much shorter, it is
    `white_acceleration` of density 2 variance tau.

    Raises FilterError.
    """
    if not (np.isfinite(tau) and tau > 0):
        raise FilterError(f"tau: must be positive and finite, not {tau}")
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / tau]])
    F, Q = van_loan(A, np.diag([0.0, 0.0, 2.0 / tau]), dt)
    each = np.eye(axes)
    return Discrete(_kron(each, F) if by_axis else _kron(F, each), _of_axes(Q, variance, axes, by_axis))


def _of_axes(Q: Array, scale: Any, axes: int, by_axis: bool) -> Array:
    """One axis' noise (..., k, k) for all, scaled. Raises FilterError."""
    factor = np.asarray(scale, float)
    if factor.shape not in {(), (axes,)} or not (np.isfinite(factor) & (factor >= 0)).all():
        raise FilterError(f"variance: must be one number, or one for each of {axes} axes, finite and not negative")
    each = np.diag(np.broadcast_to(factor, axes))
    return _kron(each, Q) if by_axis else _kron(Q, each)
