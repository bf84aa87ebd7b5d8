"""The readings of our vehicle's autopilot: state estimate, IMU, GPS and barometer."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from onboard.messages import Quaternion, Vec3
from simlink.scenarios.profiles import is_within
from simlink.scenarios.scenario import Scenario
from simlink.world import attitude
from simlink.world.attitude import add
from simlink.world.constants import DT, step_count
from simlink.world.noise import gauss_markov, gauss_markov_vectors, normals, uniforms
from simlink.world.truth import State

BAROMETER_STEPS: Final = 4  # of the world between two samples
ZERO: Final[Vec3] = (0.0, 0.0, 0.0)


class Reading(NamedTuple):
    """The state estimate and sensor readings at one step, in SI units and the named frames.

    The delayed streams (`position_*`, `gps_*`) hold values that were true one delay earlier, as on real vehicles.
    """

    q_nb: Quaternion
    omega_b: Vec3
    v_F_n: Vec3  # without delay, for studies
    position_r_OF_n: Vec3
    position_v_F_n: Vec3
    imu_f_b: Vec3
    imu_omega_b: Vec3
    gps_r_OF_n: Vec3
    gps_v_F_n: Vec3
    gps_fix: bool = True
    pwm_us: tuple[int, ...] | None = None
    voltage_v: float | None = None  # of the battery; None: nobody measures it
    pressure_altitude: float | None = None  # m; None between the barometer's samples
    state: State | None = None  # the truth itself, which an autopilot in simulation sends on request


def readings(scenario: Scenario, seed: int, world: Iterator[State]) -> Iterator[tuple[State, Reading]]:
    """Yield each state of the world with our vehicle's readings of it."""
    nav, imu, gps = scenario.nav, scenario.imu, scenario.gps
    attitude_error = gauss_markov_vectors(
        seed, "nav.attitude", nav.attitude_deg, DT, math.pi / 180, nav.yaw_deg or nav.attitude_deg
    )
    velocity_error = gauss_markov_vectors(seed, "nav.velocity", nav.velocity, DT)
    position_error = gauss_markov_vectors(seed, "nav.position", nav.position, DT)
    gps_error = gauss_markov_vectors(seed, "gps.position", gps.position, DT)
    gps_speed_sigmas = (gps.velocity_white, gps.velocity_white, gps.vertical_velocity_white)
    gps_speed_white = _scaled(seed, "gps.velocity", gps_speed_sigmas)
    accel = white(seed, "imu.accel", imu.accel_white, imu.accel_bias)
    gyro = white(seed, "imu.gyro", imu.gyro_white, imu.gyro_bias)
    position_steps, gps_steps = step_count(nav.position_delay), step_count(gps.delay)
    attitude_white = _scaled(seed, "nav.attitude_white", nav.attitude_white)
    rates_white = white(seed, "nav.rates_white", nav.rates_white)
    gps_white = _scaled(seed, "gps.position_white", gps.position_white)
    outlier = outliers(scenario, seed)
    altitude_at = barometer(scenario, seed)
    past: deque[tuple[Vec3, Vec3, Vec3, Vec3]] = deque(maxlen=max(position_steps, gps_steps) + 1)
    for state in world:
        v_F_n = add(state.v_F_n, next(velocity_error))
        past.append((add(state.r_OF_n, next(position_error)), v_F_n, state.r_OF_n, state.v_F_n))
        # until the first delay has passed: the oldest values
        r_late, v_late, _, _ = past[max(-1 - position_steps, -len(past))]
        _, _, r_gps, v_gps = past[max(-1 - gps_steps, -len(past))]
        on_attitude, on_rates, on_gps_position, on_gps_velocity = next(outlier)
        q_nb = attitude.product(state.q_nF, attitude.from_vector(*next(attitude_error)))
        tilt = add(next(attitude_white), on_attitude)
        yield (
            state,
            Reading(
                q_nb=q_nb if tilt == ZERO else attitude.product(q_nb, attitude.from_vector(*tilt)),
                omega_b=add(state.omega_b, add(next(rates_white), on_rates)),
                v_F_n=v_F_n,
                position_r_OF_n=r_late,
                position_v_F_n=v_late,
                imu_f_b=add(state.f_b, next(accel)),
                imu_omega_b=add(state.omega_b, next(gyro)),
                gps_r_OF_n=add(add(r_gps, next(gps_error)), add(next(gps_white), on_gps_position)),
                gps_v_F_n=add(add(v_gps, next(gps_speed_white)), on_gps_velocity),
                gps_fix=not is_within(state.t, gps.outages),
                pwm_us=state.pwm_us,
                voltage_v=state.voltage_v,
                pressure_altitude=altitude_at(state),
                state=state,
            ),
        )


def barometer(scenario: Scenario, seed: int) -> Callable[[State], float | None]:
    """Return a function that gives the barometer's altitude (m), or None between its samples.

    Call it once per state, in order.
    """
    b, datum = scenario.barometer, scenario.vehicle.origin[2]
    draw = normals(seed, "barometer")
    stretch = 1.0 + b.stretch * next(draw)
    drift = gauss_markov(normals(seed, "barometer.drift"), b.drift, BAROMETER_STEPS * DT)

    def at(state: State) -> float | None:
        if state.step % BAROMETER_STEPS:
            return None
        return datum - stretch * state.r_OF_n[2] + next(drift) + b.white * next(draw)

    return at


def outliers(scenario: Scenario, seed: int) -> Iterator[tuple[Vec3, Vec3, Vec3, Vec3]]:
    """Yield the outliers of each step: attitude, body rates, GPS position and velocity.

    They are in rad, rad/s, m and m/s.
    """
    o, gps = scenario.outliers, scenario.gps
    rates = (scenario.nav.rates_white,) * 3
    speed = (gps.velocity_white, gps.velocity_white, gps.vertical_velocity_white)
    sizes = (*scenario.nav.attitude_white, *rates, *gps.position_white, *speed)
    step, draw = 0, uniforms(seed, "outliers")
    while True:
        if o.probability == 0.0 or step < step_count(o.start):
            step += 1
            yield ZERO, ZERO, ZERO, ZERO
            continue
        x = [o.sigmas * size * _sign(next(draw), o.probability) for size in sizes]
        yield (x[0], x[1], x[2]), (x[3], x[4], x[5]), (x[6], x[7], x[8]), (x[9], x[10], x[11])


def _sign(u: float, probability: float) -> float:
    """Return -1 or +1, each with half the probability, else 0; `u` is uniform in [0, 1)."""
    return float(u < probability / 2) - float(u > 1 - probability / 2)


def _scaled(seed: int, name: str, sigmas: Vec3) -> Iterator[Vec3]:
    """Yield white errors with a standard deviation for each axis, without end."""
    for x, y, z in white(seed, name, 1.0 if any(sigmas) else 0.0):
        yield sigmas[0] * x, sigmas[1] * y, sigmas[2] * z


def white(seed: int, name: str, sigma: float, bias_sigma: float = 0.0) -> Iterator[Vec3]:
    """Yield vectors of independent white errors about a bias that is drawn once, without end."""
    b = normals(seed, f"{name}.bias")
    bx, by, bz = bias_sigma * next(b), bias_sigma * next(b), bias_sigma * next(b)
    z = normals(seed, name)
    while True:
        yield bx + sigma * next(z), by + sigma * next(z), bz + sigma * next(z)
