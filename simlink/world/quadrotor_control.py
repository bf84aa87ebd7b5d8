"""The quadrotor's path, and the cascaded controller that follows it.

Position and velocity errors give an acceleration, with gravity a thrust vector, and with the commanded yaw an
attitude. The attitude error gives a body rate, the rate error a torque; thrust and torques give the speed of each
rotor.
"""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple, Protocol

import numpy as np

from onboard.messages import Quaternion, Vec3
from simlink.scenarios.quadrotor import Quadrotor
from simlink.world import attitude
from simlink.world.constants import GRAVITY
from simlink.world.noise import uniforms

POSITION_GAIN: Final = (4.0, 4.0, 4.0)  # 1/s^2
VELOCITY_GAIN: Final = (3.2, 3.2, 4.0)  # 1/s
INTEGRAL_GAIN: Final = (1.0, 1.0, 1.5)  # 1/s^3
INTEGRAL_LIMIT: Final = 7.0  # m/s^2
ACCELERATION_LIMIT: Final = (6.0, 6.0, 8.0)  # m/s^2
ATTITUDE_GAIN: Final = (8.0, 8.0, 4.0)  # 1/s
RATE_GAIN: Final = (25.0, 25.0, 12.0)  # 1/s
RATE_LIMIT: Final = 6.0  # rad/s


class Reference(NamedTuple):
    """Commanded position, velocity and acceleration in n, and yaw (rad)."""

    r_n: Vec3
    v_n: Vec3
    a_n: Vec3
    yaw: float


def figure_eight(seed: int, dt: float) -> Iterator[Reference]:
    """Yield a figure eight, with a random speed and phase drawn once a run.

    The position is (4 sin a, 2 sin 2a, -10 - sin .6t) m with a = w t + phase and w = .5 (.8 + .4 U), the yaw .3
    sin .4t; U is uniform.
    """
    drawn = uniforms(seed, "quadrotor.path")
    w = 0.5 * (0.8 + 0.4 * next(drawn))
    phase = 2 * math.pi * next(drawn)
    step = 0
    while True:
        t = step * dt
        a, b = w * t + phase, 0.6 * t
        yield Reference(
            (4 * math.sin(a), 2 * math.sin(2 * a), -10 - math.sin(b)),
            (4 * w * math.cos(a), 4 * w * math.cos(2 * a), -0.6 * math.cos(b)),
            (-4 * w * w * math.sin(a), -8 * w * w * math.sin(2 * a), 0.36 * math.sin(b)),
            0.3 * math.sin(0.4 * t),
        )
        step += 1


def commanded_acceleration(reference: Reference, r_n: Vec3, v_n: Vec3, integral: Vec3) -> Vec3:
    """Return the limited acceleration in n that leads back to the path (m/s^2)."""
    commanded = []
    for i in range(3):
        e, ev = reference.r_n[i] - r_n[i], reference.v_n[i] - v_n[i]
        a = reference.a_n[i] + POSITION_GAIN[i] * e + VELOCITY_GAIN[i] * ev + integral[i]
        commanded.append(min(max(a, -ACCELERATION_LIMIT[i]), ACCELERATION_LIMIT[i]))
    return commanded[0], commanded[1], commanded[2]


class Pilot(Protocol):
    """Commands the rotors of a quadrotor."""

    def command(
        self, reference: Reference, r_n: Vec3, v_n: Vec3, q_nb: Quaternion, omega_b: Vec3, /
    ) -> tuple[float, ...]:
        """Return each rotor's speed as a share of its maximum; called once per step."""


class Controller:
    """The cascaded controller of the nominal craft; its integral compensates faults."""

    def __init__(self, craft: Quadrotor, dt: float) -> None:
        self._craft = craft
        self._dt = dt
        self._integral = [0.0, 0.0, 0.0]
        mixing = [
            [1.0] * 4,
            [-right for _, right, _ in craft.rotors],
            [x for x, _, _ in craft.rotors],
            [spin * craft.torque_per_thrust for _, _, spin in craft.rotors],
        ]
        self._allocation: list[list[float]] = np.linalg.inv(np.array(mixing)).tolist()

    def command(
        self, reference: Reference, r_n: Vec3, v_n: Vec3, q_nb: Quaternion, omega_b: Vec3
    ) -> tuple[float, ...]:
        """Return each rotor's speed as a share of its maximum."""
        for i in range(3):
            grown = self._integral[i] + INTEGRAL_GAIN[i] * (reference.r_n[i] - r_n[i]) * self._dt
            self._integral[i] = min(max(grown, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
        x, y, z = self._integral
        return self.steer(commanded_acceleration(reference, r_n, v_n, (x, y, z)), reference.yaw, q_nb, omega_b)

    def steer(self, a_n: Vec3, yaw: float, q_nb: Quaternion, omega_b: Vec3) -> tuple[float, ...]:
        """Return each rotor's speed for an acceleration in n (m/s^2) and a yaw (rad)."""
        ax, ay, az = a_n
        down = (-ax, -ay, GRAVITY - az)  # commanded direction of b's z axis
        lift = math.sqrt(down[0] ** 2 + down[1] ** 2 + down[2] ** 2)
        commanded = thrust_attitude(down, lift, yaw)
        error = attitude.to_vector(attitude.product(attitude.conjugate(q_nb), commanded))
        torque = []
        for i in range(3):
            rate = min(max(ATTITUDE_GAIN[i] * error[i], -RATE_LIMIT), RATE_LIMIT)
            torque.append(self._craft.inertia[i] * RATE_GAIN[i] * (rate - omega_b[i]))
        return self._speeds((self._craft.mass * lift, *torque))

    def _speeds(self, wrench: tuple[float, ...]) -> tuple[float, ...]:
        speeds = []
        for row in self._allocation:
            thrust = sum(a * b for a, b in zip(row, wrench, strict=True))
            share = min(max(thrust / self._craft.thrust_max, 0.0), 1.0)
            speeds.append(math.sqrt(share))
        return tuple(speeds)


def thrust_attitude(down: Vec3, length: float, yaw: float) -> Quaternion:
    """Return q_nb with z along `down` (n, of that length), tilted from level at `yaw` (rad).

    The tilt is the shortest rotation.
    """
    z = (down[0] / length, down[1] / length, down[2] / length)
    level = attitude.from_euler(0.0, 0.0, yaw)
    in_level = attitude.to_b(level, z)
    # the shortest rotation from (0, 0, 1) to in_level; never upside down, so its scalar part is not zero
    scalar = math.sqrt((1.0 + in_level[2]) / 2.0)
    tilt: Quaternion = (scalar, -in_level[1] / (2 * scalar), in_level[0] / (2 * scalar), 0.0)
    return attitude.product(level, tilt)
