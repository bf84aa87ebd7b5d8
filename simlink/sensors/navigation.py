"""What the autopilot believes: its state estimate, its IMU and its GPS, each with the scenario's errors."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from onboard.messages import Quaternion, Vec3
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.scene import GaussMarkov
from simlink.world import attitude
from simlink.world.noise import gauss_markov, normals, uniforms
from simlink.world.truth import DT, STEPS_PER_SECOND, State

BAROMETER_STEPS: Final = 4  # of the world between two samples
NOTHING: Final[Vec3] = (0.0, 0.0, 0.0)


class Reading(NamedTuple):
    """The vehicle's own sensors and estimate at one step, all stamped with that step; SI, frames as named.

    The delayed streams (`position_*`, `gps_*`) hold what was true their delay earlier, as real ones do.
    """

    q_nb: Quaternion
    omega_b: Vec3
    v_F_n: Vec3  # the estimate of now, for studies
    position_r_OF_n: Vec3
    position_v_F_n: Vec3
    imu_f_b: Vec3
    imu_omega_b: Vec3
    gps_r_OF_n: Vec3
    gps_v_F_n: Vec3
    gps_fix: bool = True
    pwm_us: tuple[int, ...] | None = None
    pressure_altitude: float | None = None  # m, where the barometer has a new one


def readings(scenario: Scenario, seed: int, world: Iterator[State]) -> Iterator[tuple[State, Reading]]:
    """Each state of the world with what the vehicle's own sensors say about it."""
    nav, imu, gps = scenario.nav, scenario.imu, scenario.gps
    tilt = errors(seed, "nav.attitude", nav.attitude_deg, math.pi / 180)
    speed = errors(seed, "nav.velocity", nav.velocity)
    place = errors(seed, "nav.position", nav.position)
    gps_place = errors(seed, "gps.position", gps.position)
    gps_speed = _scaled(
        seed, "gps.velocity", (gps.velocity_white, gps.velocity_white, gps.vertical_velocity_white)
    )
    accel = white(seed, "imu.accel", imu.accel_white, imu.accel_bias)
    gyro = white(seed, "imu.gyro", imu.gyro_white, imu.gyro_bias)
    position_steps, gps_steps = steps_of(nav.position_delay), steps_of(gps.delay)
    attitude_white = _scaled(seed, "nav.attitude_white", nav.attitude_white)
    rates_white = white(seed, "nav.rates_white", nav.rates_white)
    gps_white = _scaled(seed, "gps.position_white", gps.position_white)
    wrong = outliers(scenario, seed)
    pressed = barometer(scenario, seed)
    past: deque[tuple[Vec3, Vec3, Vec3, Vec3]] = deque(maxlen=max(position_steps, gps_steps) + 1)
    for state in world:
        v_F_n = add(state.v_F_n, next(speed))
        past.append((add(state.r_OF_n, next(place)), v_F_n, state.r_OF_n, state.v_F_n))
        # before the first delay has passed, the oldest there is
        r_then, v_then, _, _ = past[max(-1 - position_steps, -len(past))]
        _, _, r_gps, v_gps = past[max(-1 - gps_steps, -len(past))]
        tilted, spun, misplaced, misled = next(wrong)
        q_nb = attitude.product(state.q_nF, attitude.from_vector(*next(tilt)))
        shaken = add(next(attitude_white), tilted)
        yield (
            state,
            Reading(
                q_nb=q_nb if shaken == NOTHING else attitude.product(q_nb, attitude.from_vector(*shaken)),
                omega_b=add(state.omega_b, add(next(rates_white), spun)),
                v_F_n=v_F_n,
                position_r_OF_n=r_then,
                position_v_F_n=v_then,
                imu_f_b=add(state.f_b, next(accel)),
                imu_omega_b=add(state.omega_b, next(gyro)),
                gps_r_OF_n=add(add(r_gps, next(gps_place)), add(next(gps_white), misplaced)),
                gps_v_F_n=add(add(v_gps, next(gps_speed)), misled),
                gps_fix=not any(o.start <= state.t < o.end for o in gps.outages),
                pwm_us=state.pwm_us,
                pressure_altitude=pressed(state),
            ),
        )


def barometer(scenario: Scenario, seed: int) -> Callable[[State], float | None]:
    """The barometer's altitude at a state, m; None between its samples. To be asked of one state after another."""
    b, datum = scenario.barometer, scenario.vehicle.origin[2]
    draw = normals(seed, "barometer")
    stretch = 1.0 + b.stretch * next(draw)
    drift = gauss_markov(normals(seed, "barometer.drift"), b.drift.sigma, b.drift.time, BAROMETER_STEPS * DT)

    def at(state: State) -> float | None:
        if state.step % BAROMETER_STEPS:
            return None
        return datum - stretch * state.r_OF_n[2] + next(drift) + b.white * next(draw)

    return at


def outliers(scenario: Scenario, seed: int) -> Iterator[tuple[Vec3, Vec3, Vec3, Vec3]]:
    """What single wrong values add at each step to attitude (rad), rates, GPS position and velocity."""
    o, gps = scenario.outliers, scenario.gps
    rates = (scenario.nav.rates_white,) * 3
    speed = (gps.velocity_white, gps.velocity_white, gps.vertical_velocity_white)
    sizes = (*scenario.nav.attitude_white, *rates, *gps.position_white, *speed)
    step, draw = 0, uniforms(seed, "outliers")
    while True:
        if o.probability == 0.0 or step < steps_of(o.start):
            step += 1
            yield NOTHING, NOTHING, NOTHING, NOTHING
            continue
        x = [o.sigmas * size * _sign(next(draw), o.probability) for size in sizes]
        yield (x[0], x[1], x[2]), (x[3], x[4], x[5]), (x[6], x[7], x[8]), (x[9], x[10], x[11])


def _sign(u: float, probability: float) -> float:
    """-1, 0 or +1, the two each with half the probability."""
    return float(u < probability / 2) - float(u > 1 - probability / 2)


def steps_of(seconds: float) -> int:
    """The whole number of world steps nearest to a duration."""
    return round(seconds * STEPS_PER_SECOND)


def add(a: Vec3, b: Vec3) -> Vec3:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def errors(seed: int, name: str, process: GaussMarkov, unit: float = 1.0) -> Iterator[Vec3]:
    """Three independent Gauss-Markov errors, one sample per world step; sigma in `unit`s."""
    x, y, z = (
        gauss_markov(normals(seed, f"{name}.{axis}"), process.sigma * unit, process.time, DT) for axis in "xyz"
    )
    return zip(x, y, z, strict=True)


def _scaled(seed: int, name: str, sigmas: Vec3) -> Iterator[Vec3]:
    """Endless triples of white errors with a standard deviation for each axis."""
    for x, y, z in white(seed, name, 1.0 if any(sigmas) else 0.0):
        yield sigmas[0] * x, sigmas[1] * y, sigmas[2] * z


def white(seed: int, name: str, sigma: float, bias_sigma: float = 0.0) -> Iterator[Vec3]:
    """Endless triples of independent white errors, about a bias drawn once."""
    b = normals(seed, f"{name}.bias")
    bx, by, bz = bias_sigma * next(b), bias_sigma * next(b), bias_sigma * next(b)
    z = normals(seed, name)
    while True:
        yield bx + sigma * next(z), by + sigma * next(z), bz + sigma * next(z)
