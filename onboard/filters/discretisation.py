"""Discretisation: transition and process noise of a linear model over a step, and RK4.

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

SERIES_TERM_COUNT: Final = 14  # The first omitted term is below 1e-19 at a norm of 1/4.


class Discrete(NamedTuple):
    """A discrete model x' = F x + noise of covariance Q, both (..., n, n)."""

    F: Array
    Q: Array


def van_loan(A: Array, W: Array, dt: Any) -> Discrete:
    """Return the discrete model of x_dot = A x + white noise of density W.

    F = exp(A dt), and Q is the integral of exp(A s) W exp(A s)^T over the step.

    Parameters
    ----------
    A, W : (..., n, n)
        Dynamics and spectral density; for noise through L, W = L Qc L^T.
    dt : float or (...,)
        Length of the step, s.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.

    Notes
    -----
    Van Loan (1978) and the matrix fraction of Lazarov et al. (eqs 4-7) take both from one exponential of [[-A, W],
    [0, A^T]]. That needs exp(-A dt), which overflows or cancels where A decays fast. Here Q is a sum of terms that
    do not cancel: a series for a short step, doubled by Q(2h) = Q(h) + F(h) Q(h) F(h)^T.
    """
    step = _duration(dt)
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
    """Return exp(Ah), and the sum of T_k / k.

    T_1 = Wh and T_k+1 = (Ah T_k + T_k Ah^T) / k. The sum is the integral of their derivative Q' = A Q + Q A^T + W.
    """
    F = np.eye(Ah.shape[-1]) + Ah
    Q = term = np.broadcast_to(Wh, np.broadcast_shapes(Ah.shape, Wh.shape))
    power = Ah
    for k in range(2, SERIES_TERM_COUNT + 1):
        power = Ah @ power / k
        half = Ah @ term / k
        term = half + np.swapaxes(half, -1, -2)
        F, Q = F + power, Q + term
    return F, Q


def wiener_acceleration(dt: Any, q: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """Return the continuous Wiener process acceleration model, driven by white jerk.

    An axis has q [[t^5/20, t^4/8, t^3/6], [., t^3/3, t^2/2], [., ., t]]. Erratum: eq 14 of Lazarov et al. is
    indefinite.

    Parameters
    ----------
    dt : float or (...,)
        Length of the step, s.
    q
        Density of the jerk, one number or one for each axis.
    axes
        Number of axes.
    by_axis
        Order of the states: [x, vx, ax, y, ...] instead of [positions, velocities, accelerations].

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    return _kinematic(3, dt, q, axes, by_axis)


def white_acceleration(dt: Any, q: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """Return the continuous white noise acceleration model, of nearly constant velocity.

    An axis has q [[t^3/3, t^2/2], [., t]]. Parameters are those of `wiener_acceleration`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    return _kinematic(2, dt, q, axes, by_axis)


def _kinematic(order: int, dt: Any, q: Any, axes: int, by_axis: bool) -> Discrete:
    """Return the model of `order` integrations of white noise on each axis.

    F_ij = t^(j-i) / (j-i)!, and Q = q t^(a+b+1) / (a! b! (a+b+1)) for a and b integrations between the two states
    and the noise.
    """
    t = _duration(dt)[..., None, None]
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
    """Return the Kronecker product of matrices, either of which may be a batch."""
    product = np.einsum("...ij,...kl->...ikjl", a, b)
    return np.asarray(product).reshape(*product.shape[:-4], a.shape[-2] * b.shape[-2], a.shape[-1] * b.shape[-1])


def rk4(derivative: Rows, rows: Array, dt: float) -> Array:
    """Return rows after a step of x_dot = derivative(x), by classical Runge-Kutta.

    Parameters
    ----------
    derivative
        Function of rows (k, n); returns rows (k, n).
    rows : (k, n)
        States.
    dt
        Length of the step, s.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    h = float(_duration(dt))
    k1 = derivative(rows)
    if k1.shape != rows.shape:
        raise FilterError(f"derivative: gave {k1.shape} for rows {rows.shape}")
    k2 = derivative(rows + (0.5 * h) * k1)
    k3 = derivative(rows + (0.5 * h) * k2)
    k4 = derivative(rows + h * k3)
    return rows + (h / 6) * (k1 + 2 * k2 + 2 * k3 + k4)


def _duration(dt: Any) -> Array:
    """Return `dt` as an array. Raises FilterError."""
    step = np.asarray(dt, float)
    if not (np.isfinite(step) & (step >= 0)).all():
        raise FilterError(f"dt: must be finite and not negative, not {dt}")
    return step


def discrete_white_acceleration(dt: Any, variance: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """Return the discrete white noise acceleration model.

    The acceleration is constant over each step, and independent of all others. An axis has variance times
    [[t^4/4, t^3/2], [., t^2]], of rank one.

    Parameters
    ----------
    variance
        Variance of the acceleration, (m/s^2)^2, one number or one for each axis.
    dt, axes, by_axis
        As in `white_acceleration`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    F = white_acceleration(dt, 1.0, axes, by_axis).F
    t = _duration(dt)
    G = np.stack([0.5 * t * t, t], axis=-1)
    return Discrete(F, _of_axes(G[..., :, None] * G[..., None, :], variance, axes, by_axis))


def singer(dt: Any, tau: float, variance: Any = 1.0, axes: int = 3, by_axis: bool = False) -> Discrete:
    """Return the model of a manoeuvring target by Singer (1970).

    It is `wiener_acceleration` for tau much longer than the step, and `white_acceleration` of density 2 variance
    tau for tau much shorter.

    Parameters
    ----------
    tau
        Time constant of the acceleration's correlation exp(-t / tau), s.
    variance
        Variance of the acceleration, (m/s^2)^2, one number or one for each axis.
    dt, axes, by_axis
        As in `wiener_acceleration`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if not (np.isfinite(tau) and tau > 0):
        raise FilterError(f"tau: must be positive and finite, not {tau}")
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / tau]])
    F, Q = van_loan(A, np.diag([0.0, 0.0, 2.0 / tau]), dt)
    each = np.eye(axes)
    return Discrete(_kron(each, F) if by_axis else _kron(F, each), _of_axes(Q, variance, axes, by_axis))


def _of_axes(Q: Array, scale: Any, axes: int, by_axis: bool) -> Array:
    """Return one axis' noise (..., k, k) for all axes, scaled. Raises FilterError."""
    factor = np.asarray(scale, float)
    if factor.shape not in {(), (axes,)} or not (np.isfinite(factor) & (factor >= 0)).all():
        raise FilterError(f"variance: must be one number, or one for each of {axes} axes, finite and not negative")
    each = np.diag(np.broadcast_to(factor, axes))
    return _kron(each, Q) if by_axis else _kron(Q, each)
