"""Motion of another aircraft in a Cartesian frame n.

State rows: [r_OT_n (3), v_T_n (3), a_T_n (3), bias (3), attitude_error (3)], SI. The acceleration is Singer's
(1970): it decays with a time constant and is driven by white noise; gusts add to the velocity. If the aircraft
keeps its turn, the acceleration rotates with the velocity (`propagate`).

`bias` is the steady error of reported positions (GNSS, altimeter, age of the reports), in units of the standard
deviation expected of that kind of report. `attitude_error` is the rotation (rad, about n's axes) of everything
that our radar measures, because our own attitude is wrong. Both are first-order Gauss-Markov processes, and can be
distinguished only with reports and echoes of one aircraft. Without them, an error that lasts for seconds or
minutes would be averaged as if every measurement had an independent one.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import van_loan
from onboard.geometry.carried import MAX_TURN_RATE_RAD_S

STATE_SIZE: Final = 15
POSITION: Final = slice(0, 3)
VELOCITY: Final = slice(3, 6)
ACCELERATION: Final = slice(6, 9)
BIAS: Final = slice(9, 12)
ATTITUDE_ERROR: Final = slice(12, 15)
TURN_RATE_MIN_SPEED_M_S: Final = 5.0  # The turn rate is regularised below this speed.
COMPONENTS: Final = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down")
UNITS: Final = ("m", "m", "m", "m/s", "m/s", "m/s")
FRAME: Final = "n (local NED at our vehicle), the other aircraft relative to us"


class MotionModel(NamedTuple):
    """Parameters of an aircraft's motion.

    Attributes
    ----------
    acceleration
        Standard deviation (3,), m/s^2.
    acceleration_time
        Its time constant, s.
    keeps_turn
        Whether the acceleration rotates with the velocity.
    gust
        Random walk (3,) of the velocity, m/s per square root of a second.
    drift
        Random walk of the error of our own position, m per square root of a second; all positions measured from it
        share this error.
    bias_time
        Time constant of the bias, s.
    """

    acceleration: Array
    acceleration_time: float
    keeps_turn: bool
    gust: Array
    drift: float
    bias_time: float


class MotionStep(NamedTuple):
    """The transition over `dt` seconds.

    Attributes
    ----------
    F, Q
        x' = F x + noise of covariance Q, both (15, 15), or Q (k, 15, 15) for tracks that differ.
    keeps_turn
        As in `MotionModel`.
    drift
        Variance that the step adds to the error of our own position, m^2.
    """

    F: Array
    Q: Array
    dt: float
    keeps_turn: bool
    drift: float


def step(dt: float, model: MotionModel) -> MotionStep:
    """Return the transition over `dt` > 0 seconds and its noise. Raises FilterError.

    The attitude error and the correlations of report errors are added by `onboard.models.intruder.attitude_error`.
    """
    decay = 1.0 / model.acceleration_time
    axis = van_loan(
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -decay]]),
        np.diag([0.0, 0.0, 2.0 * decay]),
        dt,
    )
    F, Q = np.zeros((STATE_SIZE, STATE_SIZE)), np.zeros((STATE_SIZE, STATE_SIZE))
    F[:9, :9], Q[:9, :9] = np.kron(axis.F, np.eye(3)), np.kron(axis.Q, np.diag(model.acceleration**2))
    random_walk = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    Q[:6, :6] += np.kron(random_walk, np.diag(model.gust**2))
    drift = model.drift**2 * dt
    Q[POSITION, POSITION] += drift * np.eye(3)
    F[BIAS, BIAS] = np.exp(-dt / model.bias_time) * np.eye(3)
    Q[BIAS, BIAS] = (1.0 - np.exp(-2.0 * dt / model.bias_time)) * np.eye(3)
    return MotionStep(F, Q, dt, model.keeps_turn, drift)


def propagate(rows: Array, step: MotionStep) -> Array:
    """Return state rows (k, 15) a step later, without noise.

    If the aircraft keeps its turn, its horizontal acceleration is that at the middle of the step and rotates with
    the velocity: steps much shorter than a turn give an arc.
    """
    if not step.keeps_turn:
        return np.asarray(rows @ step.F.T)
    angle = 0.5 * step.dt * turn_rate(rows[:, VELOCITY], rows[:, ACCELERATION])
    c, s = np.cos(angle), np.sin(angle)
    later = _rotate_acceleration(rows.copy(), c, s) @ step.F.T
    return _rotate_acceleration(later, c, s)


def _rotate_acceleration(rows: Array, c: Array, s: Array) -> Array:
    """Rotate the horizontal accelerations of rows to the right.

    `c` and `s` (k,) are the cosines and sines of the angles.
    """
    north, east = rows[:, 6].copy(), rows[:, 7].copy()
    rows[:, 6], rows[:, 7] = c * north - s * east, s * north + c * east
    return rows


def turn_rate(v: Array, a: Array) -> Array:
    """Return the rate (k,) at which velocities (k, 3) turn right under accelerations (k, 3), rad/s."""
    speed2 = np.maximum(v[:, 0] ** 2 + v[:, 1] ** 2, TURN_RATE_MIN_SPEED_M_S**2)
    rate = (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / speed2
    return np.asarray(np.clip(rate, -MAX_TURN_RATE_RAD_S, MAX_TURN_RATE_RAD_S))


def backward_transition(lag: float) -> Array:
    """Return the matrix (9, 9) to position, velocity and acceleration `lag` seconds before.

    The acceleration is constant.
    """
    return np.kron(np.array([[1.0, -lag, 0.5 * lag * lag], [0.0, 1.0, -lag], [0.0, 0.0, 1.0]]), np.eye(3))


def earlier_position(rows: Array, lag: Array) -> Array:
    """Return the position (k, 3) `lag` (k,) seconds before, at constant acceleration."""
    back = lag[:, None]
    return np.asarray(rows[:, POSITION] - back * rows[:, VELOCITY] + 0.5 * back * back * rows[:, ACCELERATION])


def displacement(means: Array, covariances: Array, lag: Array) -> tuple[Array, Array]:
    """Return the displacement (k, 3) over the last `lag` (k,) seconds, and its covariance.

    The beliefs are (k, 15) and (k, 15, 15), the covariance is (k, 3, 3).
    """
    t, half = lag[:, None], 0.5 * lag[:, None] ** 2
    of_velocity = t[..., None] * covariances[:, VELOCITY, :] - half[..., None] * covariances[:, ACCELERATION, :]
    spread = t[..., None] * of_velocity[:, :, VELOCITY] - half[..., None] * of_velocity[:, :, ACCELERATION]
    return t * means[:, VELOCITY] - half * means[:, ACCELERATION], spread
