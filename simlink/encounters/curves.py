"""Smooth random curves over time, and points that move along them.

Arrays hold N times, DT apart.
"""

from collections.abc import Sequence
from itertools import islice
from typing import Final, NamedTuple

import numpy as np

from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world.constants import DT
from simlink.world.noise import gauss_markov, normals

VELOCITY_GAIN: Final = 2.0  # 1/s, of a vehicle that follows a path


class Motion(NamedTuple):
    """Position, velocity and acceleration of a point in n, each (N, 3). m, m/s, m/s^2."""

    r: Array
    v: Array
    a: Array


def heading_vector(heading: Array) -> Array:
    """Unit vectors (..., 3) in n at these headings (rad)."""
    return np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=-1)


def waves(rng: np.random.Generator, t: Array, amplitude: float, periods: Sequence[float]) -> Array:
    """Return a sum of sinusoids (N,) with random phases, below 1.2 times `amplitude`.

    Each period (s) is drawn within a quarter of the given one.
    """
    total = np.zeros_like(t)
    for period in periods:
        share = amplitude / len(periods) * rng.uniform(0.6, 1.2)
        turns = t / (period * rng.uniform(0.8, 1.25)) + rng.uniform(0.0, 1.0)
        total += share * np.sin(2.0 * np.pi * turns)
    return total


def wander(rng: np.random.Generator, t: Array, amplitudes: Sequence[float], periods: Sequence[float]) -> Array:
    """Positions (N, 3) of a point that wanders about its place, m."""
    return np.stack([waves(rng, t, amplitude, periods) for amplitude in amplitudes], axis=-1)


def motion_from_positions(r: Array) -> Motion:
    """The motion of a point at these positions (N, 3)."""
    v = np.gradient(r, DT, axis=0)
    return Motion(r, v, np.gradient(v, DT, axis=0))


def motion_from_velocities(v: Array) -> Motion:
    """The motion of a point with these velocities (N, 3), from the origin."""
    steps = 0.5 * DT * (v[1:] + v[:-1])
    return Motion(np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), v, np.gradient(v, DT, axis=0))


def follow_path(path: Array, late: float, limit: float) -> Array:
    """Return the positions (N, 3) of a vehicle that follows a path (N, 3) from its start.

    It starts at the path's velocity, reacts `late` seconds late and accelerates by at most `limit` (m/s^2). Its
    approach speed is such that it can still brake.
    """
    steps, first = round(late / DT), path[1] - path[0]
    place = np.vstack([path[0] + np.arange(steps)[:, None] * first, path + steps * first])[: len(path)]
    speed = np.gradient(place, DT, axis=0)
    r, v, found = place[0], speed[0], []
    for at, wanted in zip(place, speed, strict=True):
        found.append(r)
        off = at - r
        distance = max(float(np.linalg.norm(off)), 1e-9)
        a = VELOCITY_GAIN * (wanted + min(0.5 * VELOCITY_GAIN, np.sqrt(limit / distance)) * off - v)
        v = v + DT * a * min(1.0, limit / max(float(np.linalg.norm(a)), 1e-9))
        r = r + DT * v
    return np.array(found)


def moving_average(x: Array, seconds: float) -> Array:
    """Return the moving average of x (N,) over `seconds`, which rounds corners."""
    half = max(1, round(seconds / DT / 2))
    return np.convolve(np.pad(x, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")


def wobble(seed: int, name: str, process: GaussMarkov, samples: int, unit: float = 1.0) -> Array:
    """Return a Gauss-Markov process (N,) by `name` and `seed`, its sigma in `unit`s."""
    return np.fromiter(islice(gauss_markov(normals(seed, name), process, DT, unit), samples), float, samples)
