"""A GNSS receiver in flight, with the errors of De Vivo et al., 5.2.2-5.2.3.

It measures pseudoranges and their rates. Satellite positions and velocities are in e at the time of reception,
corrected for the Earth's rotation during the signal's flight, so that a range is the distance between two points.
Errors are the receiver's clock (common to all), the troposphere (minus a model's mean unless `corrected` is
false), multipath, and noise.

Erratum: the elevation in the multipath formula is in degrees; in radians, as printed, it has hardly any effect.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.geometry.geodesy import geodetic_from_ecef, rotation_ne
from simlink.sensors import constellation, troposphere
from simlink.sensors.arrays import Array, Flags, within


class Receiver(NamedTuple):
    """A commercial receiver and the random walks of its errors."""

    every: int = 10  # a fix at every so many-th of the given times
    mask_deg: float = 10.0  # satellites below this elevation are not used
    sigma: float = 5.0  # m, of a pseudorange, without multipath
    rate_sigma: float = 0.1  # m/s
    clock_sigma: float = 150.0  # m at the start: 500 ns
    drift_sigma: float = 1.0  # m/s at the start
    clock_walk: float = 0.05  # m^2/s
    drift_walk: float = 0.01  # (m/s)^2/s
    wet_walk: float = 1e-4 / 3600  # m^2/s, of the wet zenith delay: 1 cm^2 an hour
    corrected: bool = True  # whether it removes the mean delay of the troposphere
    day: float = 60.0  # of the year
    epoch: float = 0.0  # s, of the constellation at t = 0


class GnssConditions(NamedTuple):
    """Fault intervals [from, to), s: a degraded clock, and no signal (loss of lock)."""

    degraded: Sequence[tuple[float, float]] = ()
    lost: Sequence[tuple[float, float]] = ()
    clock_walk_factor: float = 200.0
    drift_walk_factor: float = 10.0
    noise_factor: float = 10.0
    rate_noise_factor: float = 5.0


class Fix(NamedTuple):
    """Measurements of s satellites at one time.

    `sigma` is the standard deviation that the receiver reports; it does not notice a degraded clock.
    """

    y: Array  # (2 s,): pseudoranges m, then rates m/s
    sigma: Array  # (2 s,)
    position: Array  # (s, 3) in e
    velocity: Array  # (s, 3)
    slots: npt.NDArray[np.intp]  # (s,), their indices in the constellation


class Reception(NamedTuple):
    """True clock error and drift (N, 2) in m and m/s, and a fix or None each time."""

    clock: Array
    fixes: tuple[Fix | None, ...]


def receive(
    receiver: Receiver,
    t: Array,
    r_e: Array,
    v_e: Array,
    rng: np.random.Generator,
    conditions: GnssConditions = GnssConditions(),  # noqa: B008 - immutable
) -> Reception:
    """Simulate the reception during a flight with positions and velocities (N, 3) in e.

    The times t (N,), s, are evenly spaced. Random numbers are drawn for all satellites at all times, so that a
    fault changes only the errors during it. Raises ValueError for a single time, and for a mask that admits
    satellites below the horizon.
    """
    if len(t) < 2 or not receiver.mask_deg > 0:
        raise ValueError("receive() needs at least two times and a mask above the horizon")
    n, dt = len(t), float(t[1] - t[0])
    degraded, lost = within(t, conditions.degraded), within(t, conditions.lost)
    clock = _clock(receiver, conditions, degraded, dt, rng)
    wet = troposphere.WET_ZENITH_DELAY + np.sqrt(receiver.wet_walk * dt) * np.cumsum(rng.standard_normal(n))
    noise = rng.standard_normal((n, 2, len(constellation.SLOTS)))
    fixes: list[Fix | None] = []
    for k in range(n):
        if k % receiver.every or lost[k]:
            fixes.append(None)
            continue
        worse = (conditions.noise_factor, conditions.rate_noise_factor) if degraded[k] else (1.0, 1.0)
        satellites = constellation.satellites(receiver.epoch + float(t[k]))
        fixes.append(
            fix(receiver, satellites, r_e[k], v_e[k], clock[k], float(wet[k]), noise[k] * np.array([worse]).T)
        )
    return Reception(clock, tuple(fixes))


def elevations(satellites: Array, r_e: Array) -> Array:
    """Return the elevations (s,), rad, of satellites (s, 3) over the horizon at r_e (3,)."""
    lat_deg, lon_deg, _ = geodetic_from_ecef(r_e)
    sight = satellites - r_e
    down = sight @ rotation_ne(lat_deg, lon_deg)[2]
    return np.asarray(np.arcsin(-down / np.linalg.norm(sight, axis=1)))


def multipath(elevation: Array) -> Array:
    """Return ICAO's multipath sigma (s,), m, at an elevation (s,), rad."""
    return np.asarray(0.13 + 0.53 * np.exp(-np.degrees(elevation) / 10))


def fix(
    receiver: Receiver,
    satellites: constellation.Satellites,
    r_e: Array,
    v_e: Array,
    clock: Array,
    wet: float,
    noise: Array,
) -> Fix:
    """Return the receiver's measurements at a position and velocity in e.

    `clock` (2,) is its clock's error and drift, `wet` the wet zenith delay (m), and `noise` (2, s) holds normal
    numbers for all satellites, above the mask or not.
    """
    elevation = elevations(satellites.position, r_e)
    up = np.flatnonzero(elevation >= np.radians(receiver.mask_deg))
    position, velocity, elevation = satellites.position[up], satellites.velocity[up], elevation[up]
    sight, rate = position - r_e, velocity - v_e
    distance = np.linalg.norm(sight, axis=1)
    closing = np.sum(sight * rate, axis=1) / distance
    lat_deg, _, height = geodetic_from_ecef(r_e)
    air = troposphere.delay(elevation, height, lat_deg, receiver.day, wet)
    if receiver.corrected:
        air -= troposphere.delay(elevation, height, lat_deg, receiver.day)
    sigma = np.hypot(receiver.sigma, multipath(elevation))
    rate_sigma = np.full(len(up), receiver.rate_sigma)
    y = np.concatenate(
        [
            distance + clock[0] + air + sigma * noise[0, up],
            closing + clock[1] + rate_sigma * noise[1, up],
        ]
    )
    return Fix(y, np.concatenate([sigma, rate_sigma]), position, velocity, up)


def _clock(
    receiver: Receiver,
    conditions: GnssConditions,
    degraded: Flags,
    dt: float,
    rng: np.random.Generator,
) -> Array:
    """Return clock error and drift (N, 2), m and m/s.

    Both are random walks, and the drift integrates into the error.
    """
    start = rng.standard_normal(2) * (receiver.clock_sigma, receiver.drift_sigma)
    steps = rng.standard_normal((len(degraded), 3))
    drift_walk = np.sqrt(receiver.drift_walk * np.where(degraded, conditions.drift_walk_factor, 1.0) * dt)
    clock_walk = np.sqrt(receiver.clock_walk * np.where(degraded, conditions.clock_walk_factor, 1.0) * dt)
    drift = start[1] + np.cumsum(drift_walk * steps[:, 0])
    before = np.concatenate([[start[1]], drift[:-1]])
    # within a step the drift's random walk adds dt/2 of its change, and an independent part with variance dt^2/12
    within = dt * (0.5 * (before + drift) + drift_walk / np.sqrt(12) * steps[:, 1])
    error = start[0] + np.cumsum(within + clock_walk * steps[:, 2])
    return np.column_stack([error, drift])
