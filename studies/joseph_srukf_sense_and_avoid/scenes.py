"""The scenes of De Vivo et al.: validation (section 4), radar (5.1), GNSS (5.2).

Two more are difficult for the filters.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import wiener_acceleration
from onboard.geometry.geodesy import ecef_from_geodetic, rotation_ne
from onboard.models import constant_acceleration, gnss_clock, pseudorange, radar, variable_turn
from simlink.sensors import gnss, phased_array
from simlink.sensors.phased_array import spherical
from studies.tracking.batch import Measurement, Scene
from studies.tracking.outcomes import POSITION, VELOCITY, Mask, between
from studies.tracking.trajectories import load

TARGET: Final = np.array([-6000.0, 110, -0.2, 4500, -60, 0.3, 1000, 8, -0.05])  # the validation's target at 0 s
WIDE: Final = np.tile([300.0, 30.0, 3.0], 3)  # sigmas of P0 in the validation
NARROW: Final = np.tile([100.0, 20.0, 3.0], 3)  # and with radar and GNSS
VALIDATION_SIGMA: Final = np.array([30.0, np.radians(1.45), np.radians(5.0)])
SHARP_SIGMA: Final = np.array([0.01, 1e-5, 1e-5])
EXTREME_SIGMA: Final = 1e-6 * SHARP_SIGMA  # beyond half the digits of float64 in P, for the wide prior
FAR_SIGMA: Final = np.array([1.0, 2e-4, 2e-4])
FAR_RANGE_M: Final = 20e3
FAR_START: Final = np.tile([1000.0, 30.0, 3.0], 3)
VALIDATION_DT: Final = 0.5
VALIDATION_DENSITY: Final = 0.01
DT: Final = 0.1
DENSITY: Final = 1.0

JAMMED: Final = ((70.0, 85.0),)
SIGNAL_LOST: Final = ((95.0, 105.0),)
DEGRADED: Final = ((60.0, 75.0),)
NO_SATELLITES: Final = ((90.0, 102.0),)
ORIGIN: Final = (45.2, 7.6, 300.0)  # latitude, longitude (degrees), height of the local frame
CLOCK_NOISE: Final = 0.05  # m^2/s, process noise density of the receiver's clock when it is sound
DRIFT_NOISE: Final = 0.01  # (m/s)^2/s, and of its drift
CLOCK_START: Final = (150.0, 1.0)  # m, m/s


def rng_of(seed: int, stream: int) -> np.random.Generator:
    """The random numbers of one run of one scene."""
    return np.random.default_rng([seed, stream])


def validation_times(steps: int = 200) -> Array:
    """Times of the measurements (T,), s."""
    return np.asarray(VALIDATION_DT * np.arange(1, steps + 1))


def validation(seeds: range, sigma: Array = VALIDATION_SIGMA, steps: int = 200) -> Scene:
    """A target of constant acceleration, as the filter assumes but for its process noise."""
    return _steady(seeds, TARGET, WIDE, sigma, steps, VALIDATION_DT)


def acquisition(seeds: range, steps: int = 50) -> Scene:
    """The same target from 20 km, known to 1 km, measured to 1 m in range and 4 m across."""
    x = TARGET.copy()
    x[list(POSITION)] *= FAR_RANGE_M / np.linalg.norm(x[list(POSITION)])
    return _steady(seeds, x, FAR_START, FAR_SIGMA, steps, DT)


def _steady(seeds: range, x: Array, start: Array, sigma: Array, steps: int, dt: float) -> Scene:
    F, Q = wiener_acceleration(dt, VALIDATION_DENSITY, by_axis=True)
    states = [x]
    for _ in range(steps):
        states.append(F @ states[-1])
    truth = np.array(states[1:])
    y = spherical(truth[:, POSITION])[:, None] + np.zeros((1, len(seeds), 1))
    begin = np.tile(x, (len(seeds), 1))
    for run, seed in enumerate(seeds):
        rng = rng_of(seed, 17)
        begin[run] += start * rng.standard_normal(9)
        y[:, run] += sigma * rng.standard_normal((steps, 3))
    R = np.diag(sigma**2)
    return Scene(
        truth=truth,
        start=begin,
        covariance=np.diag(start**2),
        process=lambda rows: constant_acceleration.process(rows, dt),
        noise=Q,
        measurements=lambda k: Measurement(y[k], R, radar.measure, radar.jacobian, radar.ANGULAR),
    )


def intruder() -> tuple[Array, Array]:
    """Times (T,) and states (T, 9), east, north, up, of the manoeuvring intruder."""
    trajectory = load("intruder-manoeuvring")
    return trajectory.t[1:], trajectory.states[1:]


def radar_windows(t: Array) -> dict[str, Mask]:
    """Before the faults, in each, and after."""
    return {
        "nominal": between(t, 10, JAMMED[0][0]),
        "jammed": between(t, *JAMMED[0]),
        "lost": between(t, *SIGNAL_LOST[0]),
        "after": between(t, 110, 120.1),
    }


def looks(seeds: range, rain_mm_h: float = 0.0) -> list[phased_array.Measurements]:
    """The phased array's measurements in each run."""
    t, truth = intruder()
    conditions = phased_array.RadarConditions(rain_mm_h=rain_mm_h, jammed=JAMMED, lost=SIGNAL_LOST)
    return [
        phased_array.measure(phased_array.Radar(), t, truth[:, POSITION], rng_of(seed, 51), conditions)
        for seed in seeds
    ]


def by_radar(seeds: range, rain_mm_h: float = 0.0) -> Scene:
    """The intruder by radar, R from the radar's own estimate of its errors."""
    truth, trajectory = intruder()[1], load("intruder-manoeuvring")
    found = looks(seeds, rain_mm_h)
    y = np.stack([look.y for look in found], axis=1)
    R = np.stack([look.sigma[:, :, None] ** 2 * np.eye(3) for look in found], axis=1)
    seen = found[0].detected  # by range and faults, the same in all runs
    start = trajectory.states[0] + NARROW * np.array([rng_of(s, 52).standard_normal(9) for s in seeds])
    return Scene(
        truth=truth,
        start=start,
        covariance=np.diag(NARROW**2),
        process=lambda rows: variable_turn.process(rows, DT),
        noise=lambda _, mean: variable_turn.noise(mean, DT, DENSITY),
        measurements=lambda k: (
            Measurement(y[k], R[k], radar.measure, radar.jacobian, radar.ANGULAR) if seen[k] else None
        ),
    )


def gnss_windows(t: Array) -> dict[str, Mask]:
    """Before the faults, in each, after each."""
    return {
        "nominal": between(t, 10, DEGRADED[0][0]),
        "degraded": between(t, *DEGRADED[0]),
        "between": between(t, 80, NO_SATELLITES[0][0]),
        "lost": between(t, *NO_SATELLITES[0]),
        "after": between(t, 107, 120.1),
    }


def in_ecef(states: Array) -> Array:
    """States (..., 9), east, north, up of the local frame, in frame e."""
    R_en = rotation_ne(*ORIGIN[:2]).T @ np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # from east, north, up
    rotated = np.empty_like(states)
    for kind in range(3):
        rotated[..., kind::3] = states[..., kind::3] @ R_en.T
    rotated[..., POSITION] += ecef_from_geodetic(*ORIGIN)
    return rotated


def receptions(seeds: range, corrected: bool = True) -> list[gnss.Reception]:
    """The fixes of the intruder's receiver in each run."""
    t, truth = intruder()
    e = in_ecef(truth)
    conditions = gnss.GnssConditions(degraded=DEGRADED, lost=NO_SATELLITES)
    receiver = gnss.Receiver(corrected=corrected, clock_walk=CLOCK_NOISE, drift_walk=DRIFT_NOISE)
    return [
        gnss.receive(receiver, t, e[:, POSITION], e[:, VELOCITY], rng_of(seed, 53), conditions) for seed in seeds
    ]


def snapshots(seeds: range, corrected: bool = True) -> Array:
    """Positions (T, B, 3) in e by least squares from each fix alone; NaN between fixes."""
    found = receptions(seeds, corrected)
    steps = len(found[0].fixes)
    positions = np.full((steps, len(seeds), 3), np.nan)
    for run, one in enumerate(found):
        for k, fix in enumerate(one.fixes):
            if fix is not None:
                positions[k, run] = _least_squares(fix)
    return positions


def _least_squares(fix: gnss.Fix) -> Array:
    """Return the position (3,) of the best fit to the pseudoranges, iterated from the local origin."""
    x, count = np.zeros((1, 11)), len(fix.slots)
    x[0, POSITION] = ecef_from_geodetic(*ORIGIN)
    used = [*POSITION, 9]
    weight = 1 / fix.sigma[:count, None]
    for _ in range(4):
        rest = fix.y[:count] - pseudorange.measure(x, fix.position, fix.velocity)[0, :count]
        slope = pseudorange.jacobian(x, fix.position, fix.velocity)[0, :count, used].T
        x[0, used] += np.linalg.lstsq(weight * slope, weight[:, 0] * rest, rcond=None)[0]
    return x[0, POSITION]


def by_gnss(seeds: range, corrected: bool = True) -> Scene:
    """The intruder by its own GNSS, in frame e; R does not change when the clock is degraded."""
    truth, trajectory = intruder()[1], load("intruder-manoeuvring")
    found, e = receptions(seeds, corrected), in_ecef(truth)
    clocks = np.stack([one.clock for one in found], axis=1)
    whole = np.concatenate([np.broadcast_to(e[:, None], (len(e), len(seeds), 9)), clocks], axis=2)
    sigma = np.array([*NARROW, *CLOCK_START])
    offset = NARROW * np.array([rng_of(s, 54).standard_normal(9) for s in seeds])
    start = np.hstack([in_ecef(trajectory.states[0] + offset), np.zeros((len(seeds), 2))])

    def measurements(k: int) -> Measurement | None:
        fixes = [one.fixes[k] for one in found]
        first = fixes[0]
        if first is None:
            return None
        r, v = first.position, first.velocity
        y = np.array([fix.y for fix in fixes if fix is not None])
        return Measurement(
            y,
            np.diag(first.sigma**2),
            lambda rows: pseudorange.measure(rows, r, v),
            lambda rows: pseudorange.jacobian(rows, r, v),
        )

    return Scene(
        truth=whole,
        start=start,
        covariance=np.diag(sigma**2),
        process=lambda rows: gnss_clock.process(rows, DT),
        noise=lambda _, mean: gnss_clock.noise(mean, DT, DENSITY, CLOCK_NOISE, DRIFT_NOISE),
        measurements=measurements,
    )
