"""The flights of the quadrotor study: the errors of the model, and the measurements."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.models import quadrotor
from onboard.models.quadrotor import ATTITUDE, POSITION, RATES, VELOCITY, Airframe
from studies.csvsf_quadrotor import reference_flight
from studies.csvsf_quadrotor.reference_flight import DT, Actuation, as_commanded, weak_inputs, weak_motor

STEPS: Final = 2000
FAULT_TIME_S: Final = 10.0  # scores, faults of the actuation and gusts begin here
GUST_ACCELERATION_M_S2: Final = 3.0  # horizontal
GUST_SIGMA: Final = 1.0  # m/s^2 per horizontal axis, of the Gauss-Markov part ...
GUST_TIME: Final = 1.0  # s, and its correlation time
SHORT_GUST: Final = (12.0, 14.0)  # s
GNSS_PERIOD_STEPS: Final = 10
FORCE_SIGMA: Final = 0.1  # m/s^2, white noise of the accelerometer, per axis and sample
NOMINAL: Final = Airframe()

FAST: Final = tuple(sorted((*ATTITUDE, *RATES)))
SLOW: Final = tuple(sorted((*POSITION, *VELOCITY)))
ALL: Final = tuple(range(quadrotor.STATE_SIZE))


class Sensor(NamedTuple):
    """The states that a sensor measures, and its period in steps."""

    states: tuple[int, ...]
    every: int


class Variant(NamedTuple):
    """An error of the model, and the sensors."""

    name: str
    label: str
    actuation: Actuation = as_commanded
    outliers: float = 0.0
    truth: Airframe = NOMINAL
    gust: str = ""  # "", "long" from 10 s on with a Gauss-Markov part, or "short" for two seconds
    sensors: tuple[Sensor, ...] = (Sensor(ALL, 1),)
    multirate: bool = False
    late: bool = False  # until 10 s the flight is the same as without error


def _heavier(factor: float) -> Airframe:
    return NOMINAL._replace(mass=factor * NOMINAL.mass)


def _turning_harder(factor: float) -> Airframe:
    return NOMINAL._replace(Ixx=factor * NOMINAL.Ixx, Iyy=factor * NOMINAL.Iyy, Izz=factor * NOMINAL.Izz)


NO_VELOCITY: Final = (Sensor(tuple(i for i in ALL if i not in VELOCITY), 1),)
RATES_OF_TWO: Final = (Sensor(FAST, 1), Sensor(SLOW, GNSS_PERIOD_STEPS))

VARIANTS: Final = (
    Variant("none", "no error"),
    Variant("weak", "all inputs x .7 from 10 s", actuation=weak_inputs, late=True),
    Variant("motor", "one motor -25 % from 10 s", actuation=weak_motor, late=True),
    Variant("outliers", "2 % outliers of 20 sigma", outliers=0.02),
    Variant("mass-1.3", "mass x 1.3", truth=_heavier(1.3)),
    Variant("mass-1.5", "mass x 1.5", truth=_heavier(1.5)),
    Variant("inertia-0.5", "inertias x .5", truth=_turning_harder(0.5)),
    Variant("inertia-1.5", "inertias x 1.5", truth=_turning_harder(1.5)),
    Variant("gust", "gusts of 3 m/s² from 10 s", gust="long"),
    Variant("hidden-weak", "inputs x .7, velocity not measured", actuation=weak_inputs, sensors=NO_VELOCITY),
    Variant(
        "multirate-weak",
        "inputs x .7, GPS 10 Hz",
        actuation=weak_inputs,
        sensors=RATES_OF_TWO,
        multirate=True,
    ),
    Variant("multirate-gust", "gust for 2 s, GPS 10 Hz", gust="short", sensors=RATES_OF_TWO, multirate=True),
    Variant("multirate-gusts", "gusts from 10 s, GPS 10 Hz", gust="long", sensors=RATES_OF_TWO, multirate=True),
)
NAMED: Final = {variant.name: variant for variant in VARIANTS}


class Case(NamedTuple):
    """B flights with their measurements, as arrays."""

    states: Array  # (N+1, B, 12)
    inputs: Array  # (N, B, 4), commanded
    measurements: Array  # (N, B, 12), of all states
    R: Array  # (12, 12)
    force: Array  # (N, B, 3), specific, in the body frame, by an accelerometer
    start: Array  # (B, 12), initial means


def one(case: Case, b: int) -> Case:
    """Return one of a case's flights as a case, copied to release the others' memory."""
    only = [b]
    return Case(
        case.states[:, only],
        case.inputs[:, only],
        case.measurements[:, only],
        case.R,
        case.force[:, only],
        case.start[only],
    )


def simulate(variant: Variant, seeds: Sequence[int], steps: int = STEPS) -> Case:
    """Fly the variant once per seed. A flight does not depend on the others."""
    generators = [np.random.default_rng(seed) for seed in seeds]
    others = [np.random.default_rng([seed, 1]) for seed in seeds]
    flight = reference_flight.fly(
        generators,
        steps,
        actuation=variant.actuation,
        outliers=variant.outliers,
        truth=variant.truth,
        gust=_gust(variant.gust, others, steps),
    )
    R = multirate_noise() if variant.multirate else np.array(quadrotor.MEASUREMENT_NOISE)
    sigma, measurements = np.sqrt(np.diag(R)), flight.measurements
    if variant.multirate:
        measurements = flight.states[1:] + sigma * _normal(others, (steps, quadrotor.STATE_SIZE))
    start = flight.states[0] + 2.0 * sigma * np.stack(
        [g.standard_normal(quadrotor.STATE_SIZE) for g in generators]
    )
    force = specific_force(flight.states) + FORCE_SIGMA * _normal(others, (steps, 3))
    return Case(flight.states, flight.inputs, measurements, R, force, start)


def multirate_noise() -> Array:
    """Return R (12, 12) of a GPS and of an attitude sensor.

    The GPS has .5, .5, 1 m and .15, .15, .3 m/s, the attitude sensor .01, .01, .03 rad and .01 rad/s.
    """
    sigma = np.empty(quadrotor.STATE_SIZE)
    sigma[list(POSITION)], sigma[list(VELOCITY)] = (0.5, 0.5, 1.0), (0.15, 0.15, 0.3)
    sigma[list(ATTITUDE)], sigma[list(RATES)] = (0.01, 0.01, 0.03), 0.01
    return np.diag(sigma**2)


def specific_force(states: Array) -> Array:
    """Return the measurement of an ideal accelerometer over each step (N, B, 3), m/s^2.

    It is the mean acceleration without gravity from states (N+1, B, 12), in the body axes at the beginning of the
    step.
    """
    acceleration = np.diff(states[..., list(VELOCITY)], axis=0) / DT - np.array([0.0, 0.0, NOMINAL.gravity])
    return np.asarray(np.einsum("...ij,...i->...j", matrices(states[:-1]), acceleration))


def matrices(states: Array) -> Array:
    """R_nb (..., 3, 3) of states (..., 12)."""
    half = 0.5 * states[..., list(ATTITUDE)]
    cr, cp, cy = np.moveaxis(np.cos(half), -1, 0)
    sr, sp, sy = np.moveaxis(np.sin(half), -1, 0)
    q_nb = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return matrix_from_quaternion(np.stack(q_nb, axis=-1))


def _gust(kind: str, generators: Sequence[np.random.Generator], steps: int) -> Array | None:
    """Acceleration (N, B, 3) in n, m/s^2, each flight's from a random direction."""
    if not kind:
        return None
    t = np.arange(steps) * DT
    begin, end = SHORT_GUST if kind == "short" else (FAULT_TIME_S, np.inf)
    blows = (t >= begin) & (t < end)
    gust = np.zeros((steps, len(generators), 3))
    keep = np.exp(-DT / GUST_TIME)
    for b, generator in enumerate(generators):
        bearing = generator.uniform(0.0, 2.0 * np.pi)
        gust[:, b, :2] = GUST_ACCELERATION_M_S2 * np.array([np.cos(bearing), np.sin(bearing)])
        if kind == "long":
            drive = GUST_SIGMA * np.sqrt(1 - keep**2) * generator.standard_normal((steps, 2))
            wander = np.zeros(2)
            for k in range(steps):
                wander = keep * wander + drive[k]
                gust[k, b, :2] += wander
    return np.asarray(gust * blows[:, None, None])


def _normal(generators: Sequence[np.random.Generator], shape: tuple[int, int]) -> Array:
    """Standard normal numbers (N, B, n), each flight's from its own generator."""
    return np.stack([g.standard_normal(shape) for g in generators], axis=1)
