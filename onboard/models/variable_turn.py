"""Target that turns and changes speed: a second-order Markov acceleration with state-dependent coefficients.

State rows by axis, as in `constant_acceleration`: [x, vx, ax, y, ...] in an inertial frame, or in one that turns
slowly enough (ECEF over minutes). De Vivo et al. eqs 38-44 (after Li & Jilkov 2003):
    a_dot = -2 alpha a - (2 alpha^2 + omega^2) v + noise,  omega = |v x a| / |v|^2,  alpha = -v.a / |v|^2
The model is exact for a steady turn (alpha = 0) and for a steady change of speed along a line (omega = 0).

Errata: alpha is printed with the denominator |a|^2, which gives no rate (1/s) and grows without bound in straight
flight. The matrix of eq 43 agrees with eq 42 only for omega_c^2 = alpha^2 + omega^2; printed is omega_c = alpha^2
+ omega^2. The noise includes Omega_dot x v. Appendix A's closed forms of Q_1 have the wrong sign in q22, q23, q32,
and q33 lacks + omega_c^2 e^(2 alpha dt). `noise` uses Van Loan's integral: the closed forms cancel as alpha -> 0.
"""

from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FLOAT, MAKING, ROWS, VECTOR, kernel
from onboard.filters.belief import FilterError
from onboard.filters.discretisation import van_loan
from onboard.models.constant_acceleration import ACCELERATION, POSITION, STATE_SIZE, VELOCITY

__all__ = ["ACCELERATION", "POSITION", "STATE_SIZE", "VELOCITY", "coefficients", "noise", "process"]

MAX_SERIES_ANGLE: Final = 0.5  # rad; the series of `_noise` are used for smaller turns and decays
GAUSS_RULE: Final = np.polynomial.legendre.leggauss(8)
GAUSS_NODES: Final = 0.5 * GAUSS_RULE[0]  # interval [-1/2, 1/2]
GAUSS_WEIGHTS: Final = 0.5 * GAUSS_RULE[1]
SPEED_REGULARISATION_M_S: Final = 1.0  # Its square is added to the squared speed: a hovering target has no course.


def process(rows: Array, dt: float) -> Array:
    """Return state rows (k, n) after `dt` seconds without noise, by one step of RK4 of the first nine states.

    Further states do not change.
    """
    after: Array = _process(rows, float(dt))
    return after


def coefficients(mean: Array) -> tuple[Array, Array]:
    """Return alpha (...,) and omega (...,), 1/s, of states (..., n >= 9)."""
    v, a = mean[..., VELOCITY], mean[..., ACCELERATION]
    speed2 = np.sum(v * v, axis=-1) + SPEED_REGULARISATION_M_S * SPEED_REGULARISATION_M_S
    return -np.sum(v * a, axis=-1) / speed2, np.linalg.norm(np.cross(v, a), axis=-1) / speed2


def noise(mean: Array, dt: float, q: Any = 1.0) -> Array:
    """Return the process noise (..., 9, 9) of a step about states (..., n >= 9): eq 44.

    The coefficients are constant over the step.

    Parameters
    ----------
    q
        Density of the white noise on the acceleration's derivative, (m/s^3)^2/Hz, one number or one for each axis.

    Raises
    ------
    FilterError
        If an argument is not finite, or a density is negative.
    """
    density = np.broadcast_to(np.asarray(q, float), 3)
    if not (np.isfinite(density) & (density >= 0)).all():
        raise FilterError(f"q: must be finite and not negative, not {q}")
    if dt > 0:
        rows = mean.reshape(-1, mean.shape[-1])
        Q, reach = _noise(rows, float(dt), density, GAUSS_NODES, GAUSS_WEIGHTS)
        if reach <= MAX_SERIES_ANGLE:
            whole: Array = Q.reshape(*mean.shape[:-1], STATE_SIZE, STATE_SIZE)
            return whole
    return _noise_of_any_step(mean, dt, density)


def _noise_of_any_step(mean: Array, dt: float, density: Array) -> Array:
    alpha, omega = coefficients(mean)
    A = np.zeros((*alpha.shape, 3, 3))
    A[..., 0, 1] = A[..., 1, 2] = 1.0
    A[..., 2, 1] = -(2.0 * alpha**2 + omega**2)
    A[..., 2, 2] = -2.0 * alpha
    one = van_loan(A, np.diag([0.0, 0.0, 1.0]), dt).Q
    Q = np.zeros((*alpha.shape, STATE_SIZE, STATE_SIZE))
    for axis in range(3):
        at = slice(3 * axis, 3 * axis + 3)
        Q[..., at, at] = density[axis] * one
    return Q


@kernel((ROWS, FLOAT, VECTOR, VECTOR, VECTOR), **MAKING)
def _noise(rows, dt, density, nodes, weights):
    """Return Q (k, 9, 9) and the largest turn or decay in a step, rad.

    The response to a unit impulse is the series of a_dot = -p v - r a from v = 0, a = 1. Its products are
    integrated by Gauss' rule, all of whose terms are positive, so Q is positive, too.
    """
    Q = np.zeros((rows.shape[0], 9, 9))
    c, reach = np.empty(3), 0.0
    for s in range(rows.shape[0]):
        vv, va, aa = SPEED_REGULARISATION_M_S * SPEED_REGULARISATION_M_S, 0.0, 0.0
        for i in range(0, 9, 3):
            vv += rows[s, i + 1] * rows[s, i + 1]
            va += rows[s, i + 1] * rows[s, i + 2]
            aa += rows[s, i + 2] * rows[s, i + 2]
        alpha = -va / vv
        r = 2.0 * alpha
        p = 2.0 * alpha * alpha + max(
            (vv - SPEED_REGULARISATION_M_S * SPEED_REGULARISATION_M_S) * aa - va * va, 0.0
        ) / (vv * vv)
        reach = max(reach, dt * max(abs(r), np.sqrt(p)))
        for g in range(nodes.shape[0]):
            t = dt * (0.5 + nodes[g])
            term, before = 1.0, 0.0  # of the acceleration's series: the present and the previous one
            c[0] = c[1] = c[2] = 0.0
            for k in range(15):
                c[2] += term
                c[1] += term * t / (k + 1)
                c[0] += term * t * t / ((k + 1) * (k + 2))
                after = -(r * t * term + (p * t * t * before / k if k else 0.0)) / (k + 1)
                term, before = after, term
            for i in range(3):
                for j in range(3):
                    Q[s, i, j] += dt * weights[g] * c[i] * c[j]
        for axis in range(2, -1, -1):  # the first block last: the others need it
            for i in range(3):
                for j in range(3):
                    Q[s, 3 * axis + i, 3 * axis + j] = density[axis] * Q[s, i, j]
    return Q, reach


@kernel(**MAKING)
def _jerk(v, a, jerk):
    """Write the jerk of eq 42 into `jerk` (3,), for a velocity and an acceleration (3,)."""
    vv = va = aa = 0.0
    for i in range(3):
        vv += v[i] * v[i]
        va += v[i] * a[i]
        aa += a[i] * a[i]
    cross2 = max(vv * aa - va * va, 0.0)  # |v x a|^2
    vv += SPEED_REGULARISATION_M_S * SPEED_REGULARISATION_M_S
    alpha = -va / vv
    pull = 2.0 * alpha * alpha + cross2 / (vv * vv)
    for i in range(3):
        jerk[i] = -2.0 * alpha * a[i] - pull * v[i]


@kernel((ROWS, FLOAT), **MAKING)
def _process(rows, dt):
    after = rows.copy()
    v, a = np.empty((4, 3)), np.empty((4, 3))  # at the four stages
    j = np.empty((4, 3))
    for s in range(rows.shape[0]):
        for k in range(4):
            for i in range(3):
                h = 0.0 if k == 0 else dt if k == 3 else 0.5 * dt
                v[k, i] = rows[s, 3 * i + 1] + (h * a[k - 1, i] if k else 0.0)
                a[k, i] = rows[s, 3 * i + 2] + (h * j[k - 1, i] if k else 0.0)
            _jerk(v[k], a[k], j[k])
        for i in range(3):
            after[s, 3 * i] += dt / 6.0 * (v[0, i] + 2.0 * (v[1, i] + v[2, i]) + v[3, i])
            after[s, 3 * i + 1] += dt / 6.0 * (a[0, i] + 2.0 * (a[1, i] + a[2, i]) + a[3, i])
            after[s, 3 * i + 2] += dt / 6.0 * (j[0, i] + 2.0 * (j[1, i] + j[2, i]) + j[3, i])
    return after
