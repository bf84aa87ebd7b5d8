"""Another aircraft's motion in a Cartesian frame n, and what a radar and its own reports say of it.

State rows: [r_OT_n (3), v_T_n (3), a_T_n (3), bias (3)], SI. The acceleration is Singer's (1970): it fades with a
time constant and is driven by white noise. `bias` is by how much the positions that the aircraft reports of itself
are steadily off (its GNSS, its altimeter, the age of its reports): a first-order Gauss-Markov process, known apart
only where a radar sees the aircraft too. Without it, a reported position that errs the same way for a minute would
be averaged as if every report were news.

A measurement may be older than the state: `lag` seconds, for each row. The state is then moved back as if its
acceleration were constant; what noise does in a second is small against any reported position.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.filters.discretisation import van_loan
from onboard.geometry.rotations import Array

N: Final = 12
R: Final = slice(0, 3)
V: Final = slice(3, 6)
A: Final = slice(6, 9)
BIAS: Final = slice(9, 12)
COMPONENTS: Final = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down")
UNITS: Final = ("m", "m", "m", "m/s", "m/s", "m/s")
FRAME: Final = "n (local NED at our vehicle), the other aircraft relative to us"
POLAR: Final = ("range", "azimuth", "elevation")
POLAR_UNITS: Final = ("m", "rad", "rad")
POLAR_ANGULAR: Final = (1, 2)

ROWS: Final = types.Array(types.float64, 2, "A", readonly=True)
VECTOR: Final = types.Array(types.float64, 1, "A", readonly=True)


class Noise(NamedTuple):
    """Acceleration: standard deviation on each axis (m/s^2) and time constant (s). The bias's standard deviation
    on each axis (3,), m, and time constant (s)."""

    acceleration: float
    acceleration_time: float
    bias: Array
    bias_time: float


class Step(NamedTuple):
    """What `dt` seconds do: x' = F x + noise of covariance Q, both (12, 12)."""

    F: Array
    Q: Array


def step(dt: float, noise: Noise) -> Step:
    """The transition over `dt` > 0 seconds and its noise.

    Raises FilterError.
    """
    fade = 1.0 / noise.acceleration_time
    axis = van_loan(
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -fade]]),
        np.diag([0.0, 0.0, 2.0 * noise.acceleration**2 * fade]),
        dt,
    )
    F, Q = np.zeros((N, N)), np.zeros((N, N))
    F[:9, :9], Q[:9, :9] = np.kron(axis.F, np.eye(3)), np.kron(axis.Q, np.eye(3))
    F[BIAS, BIAS] = np.exp(-dt / noise.bias_time) * np.eye(3)
    Q[BIAS, BIAS] = np.diag(noise.bias**2 * (1.0 - np.exp(-2.0 * dt / noise.bias_time)))
    return Step(F, Q)


def back(lag: float) -> Array:
    """Position, velocity and acceleration `lag` seconds before, (9, 9) of those now."""
    return np.kron(np.array([[1.0, -lag, 0.5 * lag * lag], [0.0, 1.0, -lag], [0.0, 0.0, 1.0]]), np.eye(3))


def reported(rows: Array, lag: Array) -> Array:
    """Position (with its bias) and velocity (k, 6) that the aircraft said it had `lag` (k,) seconds before."""
    said = np.empty((len(rows), 6))
    said[:, R] = located(rows, lag) + rows[:, BIAS]
    said[:, V] = rows[:, V] - lag[:, None] * rows[:, A]
    return said


def located(rows: Array, lag: Array) -> Array:
    """Position (k, 3) `lag` (k,) seconds before."""
    back = lag[:, None]
    return np.asarray(rows[:, R] - back * rows[:, V] + 0.5 * back * back * rows[:, A])


def seen(rows: Array, lag: Array, r_OR_n: Array, R_rn: Array) -> Array:
    """Range (m), azimuth (positive right) and elevation (positive up, rad), (k, 3), seen `lag` (k,) seconds before
    by a radar at r_OR_n (3,) with attitude R_rn (3, 3)."""
    polar: Array = _seen(rows, lag, r_OR_n, R_rn)
    return polar


def position(polar: Array, r_OR_n: Array, R_rn: Array) -> Array:
    """r_OT_n (k, 3) of polar measurements (k, 3)."""
    r, azimuth, elevation = polar[:, 0], polar[:, 1], polar[:, 2]
    level = r * np.cos(elevation)
    cartesian = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -r * np.sin(elevation)], axis=-1)
    return np.asarray(cartesian @ R_rn + r_OR_n)


def position_noise(polar: Array, sigma: Array, R_rn: Array) -> Array:
    """Covariance (k, 3, 3) in n of `position`, of polar measurements (k, 3) with standard deviations (k, 3)."""
    r, azimuth, elevation = polar[:, 0], polar[:, 1], polar[:, 2]
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    slope = np.stack(
        [
            np.stack([ce * ca, -r * ce * sa, -r * se * ca], axis=-1),
            np.stack([ce * sa, r * ce * ca, -r * se * sa], axis=-1),
            np.stack([-se, np.zeros_like(r), -r * ce], axis=-1),
        ],
        axis=-2,
    )
    turned = (R_rn.T @ slope) * sigma[:, None, :]
    return np.asarray(turned @ np.swapaxes(turned, -1, -2))


@njit((ROWS, VECTOR, VECTOR, ROWS), cache=True, error_model="numpy")
def _seen(rows, lag, r_OR_n, R_rn):  # type: ignore[no-untyped-def]
    polar = np.empty((rows.shape[0], 3))
    for s in range(rows.shape[0]):
        x, y, z = 0.0, 0.0, 0.0
        for i in range(3):
            then = rows[s, i] - lag[s] * (rows[s, 3 + i] - 0.5 * lag[s] * rows[s, 6 + i])
            difference = then - r_OR_n[i]
            x += R_rn[0, i] * difference
            y += R_rn[1, i] * difference
            z += R_rn[2, i] * difference
        level = np.sqrt(x * x + y * y)
        polar[s, 0] = np.sqrt(level * level + z * z)
        polar[s, 1] = np.arctan2(y, x)
        polar[s, 2] = np.arctan2(-z, level)
    return polar


def expected(means: Array, covariances: Array, lag: float, r_OR_n: Array, R_rn: Array) -> tuple[Array, Array]:
    """What a radar should see (k, 3) of beliefs (k, 12) and (k, 12, 12), and the covariance (k, 3, 3) of that
    without the radar's own noise, to first order."""
    outputs: tuple[Array, Array] = _expected(means, covariances, lag, r_OR_n, R_rn)
    return outputs


CUBES: Final = types.Array(types.float64, 3, "A", readonly=True)
EXPECTED: Final[Any] = (ROWS, CUBES, types.float64, VECTOR, ROWS)


@njit(EXPECTED, cache=True, error_model="numpy")
def _expected(means, covariances, lag, r_OR_n, R_rn):  # type: ignore[no-untyped-def]
    count = means.shape[0]
    polar, spread = np.empty((count, 3)), np.empty((count, 3, 3))
    P, H = np.empty((3, 3)), np.empty((3, 3))
    back = np.array([1.0, -lag, 0.5 * lag * lag])
    for s in range(count):
        for i in range(3):  # covariance of the position `lag` before
            for j in range(3):
                total = 0.0
                for a in range(3):
                    for b in range(3):
                        total += back[a] * back[b] * covariances[s, 3 * a + i, 3 * b + j]
                P[i, j] = total
        x, y, z = 0.0, 0.0, 0.0
        for i in range(3):
            difference = means[s, i] + back[1] * means[s, 3 + i] + back[2] * means[s, 6 + i] - r_OR_n[i]
            x += R_rn[0, i] * difference
            y += R_rn[1, i] * difference
            z += R_rn[2, i] * difference
        level2 = max(x * x + y * y, 1.0)  # straight above, where azimuth means nothing, it is not infinite
        level, r2 = np.sqrt(level2), max(x * x + y * y + z * z, 1.0)
        r = np.sqrt(r2)
        polar[s, 0], polar[s, 1], polar[s, 2] = r, np.arctan2(y, x), np.arctan2(-z, level)
        for i in range(3):
            a, b, c_ = R_rn[0, i], R_rn[1, i], R_rn[2, i]
            H[0, i] = (x * a + y * b + z * c_) / r
            H[1, i] = (x * b - y * a) / level2
            H[2, i] = (z * (x * a + y * b) / level - level * c_) / r2
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    for m in range(3):
                        total += H[i, k] * P[k, m] * H[j, m]
                spread[s, i, j] = total
    return polar, spread
