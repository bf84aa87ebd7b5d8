"""A quadrotor: a rigid body with six degrees of freedom under four rotors.

Its state is r_OF_n, v_F_n, q_nb, omega_b, and the speed of each rotor as a share of its maximum, integrated by
Runge-Kutta. A rotor at (x, y) in b (forward, right) pushes up with the square of its speed and turns the body
about -y x thrust (roll), x thrust (pitch) and its own drag torque (yaw); its speed follows the command with a lag.
Rotor drag acts against the velocity along b's x and y. No filter's model is used here.
"""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from onboard.messages import Quaternion, Vec3
from simlink.scenarios.profiles import is_within
from simlink.scenarios.quadrotor import Battery, Quadrotor, QuadrotorFault
from simlink.world import attitude
from simlink.world.constants import GRAVITY
from simlink.world.motion import Row, runge_kutta
from simlink.world.noise import gauss_markov, gauss_markov_vectors, normals
from simlink.world.quadrotor_control import Controller, Pilot, Reference, thrust_attitude

PWM_US: Final = (1000, 2000)  # of a rotor at rest and at its maximum speed

Body = Row  # r (3), v (3), q (4), omega (3), rotor speeds (4)


class Forces(NamedTuple):
    """The parameters of the forces during one step."""

    thrusts: tuple[float, float, float, float]  # N, of each rotor at full speed
    mass: float  # kg
    inertia: Vec3  # kg m^2
    wind_n: Vec3  # m/s^2, the wind's acceleration


class QuadrotorState(NamedTuple):
    """The quadrotor at one step, in SI units; `pwm_us` are the commands to its motors."""

    r_n: Vec3
    v_n: Vec3
    a_n: Vec3
    q_nb: Quaternion
    omega_b: Vec3
    f_b: Vec3
    pwm_us: tuple[int, ...]
    fault: str
    voltage_v: float


def derivative(craft: Quadrotor, forces: Forces, command: Body, y: Body) -> tuple[Body, Vec3]:
    """Return the time derivative of a body's state, and its specific force in b (m/s^2)."""
    q: Quaternion = (y[6], y[7], y[8], y[9])
    p, w, r = y[10:13]
    vx, vy, _ = attitude.to_b(q, (y[3], y[4], y[5]))
    lift = roll = pitch = yaw = 0.0
    for (x, right, spin), full, share in zip(craft.rotors, forces.thrusts, y[13:], strict=True):
        thrust = full * share * share
        lift += thrust
        roll -= right * thrust
        pitch += x * thrust
        yaw += spin * craft.torque_per_thrust * thrust
    px, py, pz = attitude.to_b(q, forces.wind_n)
    f_b = (px - craft.drag * vx, py - craft.drag * vy, pz - lift / forces.mass)
    ax, ay, az = attitude.to_n(q, f_b)
    ixx, iyy, izz = forces.inertia
    turn = attitude.product(q, (0.0, p, w, r))
    return (
        y[3], y[4], y[5],
        ax, ay, az + GRAVITY,
        0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2], 0.5 * turn[3],
        (roll + (iyy - izz) * w * r) / ixx,
        (pitch + (izz - ixx) * p * r) / iyy,
        (yaw + (ixx - iyy) * p * w) / izz,
        *((c - s) / craft.motor_time for c, s in zip(command, y[13:], strict=True)),
    ), f_b  # fmt: skip


def advance(craft: Quadrotor, forces: Forces, command: Body, y: Body, dt: float) -> Body:
    """Return the body one step later, with its quaternion normalised."""

    def slope(_: float, y: Body) -> Body:
        return derivative(craft, forces, command, y)[0]

    after = list(runge_kutta(slope, 0.0, y, slope(0.0, y), dt))
    length = math.sqrt(sum(x * x for x in after[6:10]))
    after[6:10] = [x / length for x in after[6:10]]
    return tuple(after)


def quadrotor_states(
    craft: Quadrotor, seed: int, references: Iterator[Reference], dt: float, pilot: Pilot | None = None
) -> Iterator[QuadrotorState]:
    """Yield the quadrotor's state every `dt` seconds along `references`, one per step.

    Its controller or `pilot` flies it. Both know the true state: the flight must not depend on the estimator under
    test.
    """
    controller = pilot or Controller(craft, dt)
    turbulence = gauss_markov_vectors(seed, "quadrotor.air", craft.turbulence, dt)
    wobble = [gauss_markov(normals(seed, f"quadrotor.gust.{axis}"), craft.gust.wobble, dt) for axis in "xy"]
    y: Body | None = None
    for step, reference in enumerate(references):
        t = step * dt
        if y is None:
            hover = math.sqrt(craft.mass * GRAVITY / (4 * craft.thrust_max))
            ax, ay, az = reference.a_n
            down = (-ax, -ay, GRAVITY - az)
            tilted = thrust_attitude(down, math.sqrt(sum(x * x for x in down)), reference.yaw)
            y = (*reference.r_n, *reference.v_n, *tilted, 0.0, 0.0, 0.0, hover, hover, hover, hover)
        wind = _wind(craft, t, next(turbulence), (next(wobble[0]), next(wobble[1])))
        forces = forces_at(craft, t, wind)
        q: Quaternion = (y[6], y[7], y[8], y[9])
        command = controller.command(reference, (y[0], y[1], y[2]), (y[3], y[4], y[5]), q, (y[10], y[11], y[12]))
        slope, f_b = derivative(craft, forces, command, y)
        yield QuadrotorState(
            (y[0], y[1], y[2]),
            (y[3], y[4], y[5]),
            (slope[3], slope[4], slope[5]),
            q,
            (y[10], y[11], y[12]),
            f_b,
            tuple(round(PWM_US[0] + (PWM_US[1] - PWM_US[0]) * c) for c in command),
            active_faults(craft, t),
            voltage_at(craft.battery, t),
        )
        y = advance(craft, forces, command, y, dt)


def forces_at(craft: Quadrotor, t: float, wind_n: Vec3) -> Forces:
    """Return the parameters of the forces at time `t` (s), with the scenario's fault from its onset."""
    fault = craft.fault if t >= craft.fault.at else QuadrotorFault()
    share = voltage_at(craft.battery, t) / craft.battery.full
    full = [craft.thrust_max * fault.inputs * share * share] * 4
    if fault.motor:
        full[fault.motor - 1] *= 1.0 - fault.motor_loss
    i, j, k = craft.inertia
    inertia = (i * fault.inertia, j * fault.inertia, k * fault.inertia)
    return Forces((full[0], full[1], full[2], full[3]), craft.mass * fault.mass, inertia, wind_n)


def voltage_at(battery: Battery, t: float) -> float:
    """Return the battery's voltage at time `t` (s), V."""
    used = min(t / (60.0 * battery.minutes), 1.0) if battery.minutes else 0.0
    return battery.full + used * (battery.empty - battery.full)


def active_faults(craft: Quadrotor, t: float) -> str:
    """Return the names of the faults at time `t` (s), "" if there is none."""
    found = []
    fault = craft.fault
    if t >= fault.at:
        found += [f"motor {fault.motor}"] if fault.motor and fault.motor_loss else []
        found += ["inputs"] if fault.inputs != 1.0 else []
        found += ["mass"] if fault.mass != 1.0 else []
        found += ["inertia"] if fault.inertia != 1.0 else []
    return ", ".join(found + (["gust"] if _gusts(craft, t) else []))


def _wind(craft: Quadrotor, t: float, air: Vec3, wobble: tuple[float, float]) -> Vec3:
    """Return the wind's acceleration in n: steady wind, turbulence, and the gust in its interval."""
    air = attitude.add(air, (craft.drag * craft.wind[0], craft.drag * craft.wind[1], 0.0))
    if not _gusts(craft, t):
        return air
    north, east, down = craft.gust.acceleration
    return air[0] + north + wobble[0], air[1] + east + wobble[1], air[2] + down


def _gusts(craft: Quadrotor, t: float) -> bool:
    return craft.gust.when is not None and is_within(t, [craft.gust.when])
