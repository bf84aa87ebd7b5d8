"""The reference flight of the quadrotor, for the study and tests of the filters.

It is a figure eight under control: (4 sin a, 2 sin 2a, -10 - sin .6t) m with a = w t + phase, w = .5 (.8 + .4 U),
yaw .3 sin .4t. The controller is a cascade: position to acceleration, its norm to thrust, its direction to tilt,
attitude to rate, rate to torque. It uses the truth, so that the flight does not depend on the filter.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import wrap_angle
from onboard.models import quadrotor
from onboard.models.quadrotor import ATTITUDE, POSITION, RATES, VELOCITY, Airframe

DT: Final = 0.01
YAW_ARM: Final = 0.03826  # m: torque of a rotor over its thrust
ACCELERATION_LIMIT: Final = np.array([6.0, 6.0, 5.0])
POSITION_GAIN: Final = np.array([4.0, 4.0, 4.0])
VELOCITY_GAIN: Final = np.array([3.2, 3.2, 4.0])
INTEGRAL_GAIN: Final = np.array([0.0, 0.0, 1.0])
ATTITUDE_GAIN: Final = np.array([8.0, 8.0, 4.0])
THRUST_LIMIT: Final = 0.8  # N, of d_roll and d_pitch
TORQUE_LIMIT: Final = 0.05  # N m, of d_yaw

Actuation = Callable[[float, Array], Array]


def process_noise() -> Array:
    """Return the truth's process noise of one step (12, 12).

    The variances are 1e-8 of position and attitude, 4e-6 of velocity, 2.5e-5 of the rates.
    """
    variance = np.full(quadrotor.STATE_SIZE, 1e-8)
    variance[list(VELOCITY)] = 4e-6
    variance[list(RATES)] = 2.5e-5
    return np.diag(variance)


class Path(NamedTuple):
    """One figure eight per row: its rate (rad/s) and phase (rad), each (B,)."""

    rate: Array
    phase: Array


def draw_path(generators: Sequence[np.random.Generator]) -> Path:
    """A path from each generator."""
    drawn = np.array([g.random(2) for g in generators])
    return Path(0.5 * (0.8 + 0.4 * drawn[:, 0]), 2.0 * np.pi * drawn[:, 1])


def along(path: Path, t: float) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (B, 3) on the path at time `t`."""
    w, a = path.rate, path.rate * t + path.phase
    v = np.full_like(w, 0.6 * t)
    position = np.stack([4 * np.sin(a), 2 * np.sin(2 * a), -10 - np.sin(v)], axis=1)
    velocity = np.stack([4 * w * np.cos(a), 4 * w * np.cos(2 * a), -0.6 * np.cos(v)], axis=1)
    acceleration = np.stack([-4 * w**2 * np.sin(a), -8 * w**2 * np.sin(2 * a), 0.36 * np.sin(v)], axis=1)
    return position, velocity, acceleration


def start(path: Path) -> Array:
    """States (B, 12) on the path, level, at time 0."""
    state = np.zeros((len(path.rate), quadrotor.STATE_SIZE))
    state[:, POSITION], state[:, VELOCITY], _ = along(path, 0.0)
    return state


def command(state: Array, path: Path, t: float, integral: Array, airframe: Airframe) -> Array:
    """Return the inputs (B, 4) that follow the path from `state` (B, 12).

    `integral` (B, 3) is that of the position error.
    """
    position, velocity, feed_forward = along(path, t)
    wanted = (
        feed_forward
        + POSITION_GAIN * (position - state[:, POSITION])
        + VELOCITY_GAIN * (velocity - state[:, VELOCITY])
        + INTEGRAL_GAIN * integral
    )
    lift = np.array([0.0, 0.0, airframe.gravity]) - np.clip(wanted, -ACCELERATION_LIMIT, ACCELERATION_LIMIT)
    norm = np.linalg.norm(lift, axis=1)
    x, y, z = (lift / norm[:, None]).T
    psi = state[:, 10]
    c, s = np.cos(psi), np.sin(psi)
    attitude = np.stack([np.arcsin(x * s - y * c), np.arctan2(x * c + y * s, z)], axis=1)
    yaw = np.full((len(psi), 1), 0.3 * np.sin(0.4 * t))
    error = wrap_angle(np.concatenate([attitude, yaw], axis=1) - state[:, ATTITUDE])
    inertia = np.array([25 * airframe.Ixx / airframe.arm, 25 * airframe.Iyy / airframe.arm, 12 * airframe.Izz])
    limit = np.array([THRUST_LIMIT, THRUST_LIMIT, TORQUE_LIMIT])
    torque = np.clip(inertia * (ATTITUDE_GAIN * error - state[:, RATES]), -limit, limit)
    return np.concatenate([airframe.mass * norm[:, None], torque], axis=1)


def as_commanded(_t: float, inputs: Array) -> Array:
    """Actuation without error."""
    return inputs


def weak_inputs(t: float, inputs: Array) -> Array:
    """All four inputs reduced to 0.7 from 10 s."""
    return 0.7 * inputs if t >= 10.0 else inputs


def weak_motor(t: float, inputs: Array) -> Array:
    """Reduce rotor 1 by a quarter of its commanded T1 = u/4 + d_pitch/2 + d_yaw/(4 c) from 10 s on."""
    if t < 10.0:
        return inputs
    u, _, d_pitch, d_yaw = inputs.T
    loss = 0.25 * (u / 4 + d_pitch / 2 + d_yaw / (4 * YAW_ARM))
    return np.asarray(inputs - loss[:, None] * np.array([1.0, 0.0, 1.0, YAW_ARM]))


class Flight(NamedTuple):
    """B flights of N steps."""

    states: Array
    inputs: Array
    measurements: Array


def fly(
    generators: Sequence[np.random.Generator],
    steps: int = 2000,
    actuation: Actuation = as_commanded,
    outliers: float = 0.0,
    airframe: Airframe = Airframe(),  # noqa: B008 - immutable
    truth: Airframe | None = None,
    gust: Array | None = None,
) -> Flight:
    """Fly one figure eight per generator.

    `actuation(t, inputs)` gives the inputs that act in place of those commanded; `outliers` is each measurement's
    probability of an error of 20 standard deviations; `truth` is the craft where it differs from the `airframe`
    that the controller assumes; `gust` (steps, B, 3) accelerates it, NED, m/s^2.
    """
    path = draw_path(generators)
    state = start(path)
    sigma_process = np.sqrt(np.diag(process_noise()))
    sigma = np.sqrt(np.diag(quadrotor.MEASUREMENT_NOISE))
    noise = np.stack([g.standard_normal((steps, 2, quadrotor.STATE_SIZE)) for g in generators], axis=2)
    sign = np.stack([outlier_signs(g, steps, outliers) for g in generators], axis=1)
    states, inputs = np.empty((steps + 1, *state.shape)), np.empty((steps, len(state), 4))
    states[0] = state
    integral = np.zeros((len(state), 3))
    for k in range(steps):
        t = k * DT
        inputs[k] = command(state, path, t, integral, airframe)
        integral = integral + DT * (along(path, t)[0] - state[:, POSITION])
        state = quadrotor.process(state, actuation(t, inputs[k]), DT, truth or airframe)
        if gust is not None:
            state[:, VELOCITY] += DT * gust[k]
        state = state + sigma_process * noise[k, 0]
        states[k + 1] = state
    return Flight(states, inputs, states[1:] + sigma * (noise[:, 1] + 20.0 * sign))


def outlier_signs(generator: np.random.Generator, steps: int, probability: float) -> Array:
    """-1, 0 or +1 for each measurement (steps, 12)."""
    drawn = generator.random((steps, quadrotor.STATE_SIZE))
    return np.asarray((drawn < probability / 2).astype(float) - (drawn > 1 - probability / 2).astype(float))
