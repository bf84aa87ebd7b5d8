"""Smooth random curves over time, and points that move along them. Arrays: N times, DT apart."""

from collections.abc import Sequence
from itertools import islice
from typing import Final, NamedTuple

import numpy as np

from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world.constants import DT
from simlink.world.noise import gauss_markov, normals

GAIN: Final = 2.0  # 1/s, of the velocity of one that follows


class Motion(NamedTuple):
    """Position, velocity and acceleration of a point in n, each (N, 3). m, m/s, m/s^2."""

    r: Array
    v: Array
    a: Array


def level(heading: Array) -> Array:
    """Unit vectors (..., 3) in n at these headings (rad)."""
    return np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=-1)


def waves(rng: np.random.Generator, t: Array, amplitude: float, periods: Sequence[float]) -> Array:
    """A sum of sinusoids (N,), its periods (s) up to a quarter off, its phases random. Its value stays below 1.2
    times `amplitude`, whose unit it has."""
    total = np.zeros_like(t)
    for period in periods:
        share = amplitude / len(periods) * rng.uniform(0.6, 1.2)
        turns = t / (period * rng.uniform(0.8, 1.25)) + rng.uniform(0.0, 1.0)
        total += share * np.sin(2.0 * np.pi * turns)
    return total


def wander(rng: np.random.Generator, t: Array, amplitudes: Sequence[float], periods: Sequence[float]) -> Array:
    """Positions (N, 3) of a point that wanders about its place, m."""
    return np.stack([waves(rng, t, amplitude, periods) for amplitude in amplitudes], axis=-1)


def moving(r: Array) -> Motion:
    """The motion of a point at these positions (N, 3)."""
    v = np.gradient(r, DT, axis=0)
    return Motion(r, v, np.gradient(v, DT, axis=0))


def travelling(v: Array) -> Motion:
    """The motion of a point with these velocities (N, 3), from the origin."""
    steps = 0.5 * DT * (v[1:] + v[:-1])
    return Motion(np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), v, np.gradient(v, DT, axis=0))


def following(path: Array, late: float, limit: float) -> Array:
    """Positions (N, 3) of one that follows a path (N, 3) from its beginning, in step with it at first. It reacts
    `late` s late, and accelerates by `limit` m/s^2 at most: it flies as fast as the path, and so much towards its
    place that it can brake."""
    steps, first = round(late / DT), path[1] - path[0]
    place = np.vstack([path[0] + np.arange(steps)[:, None] * first, path + steps * first])[: len(path)]
    speed = np.gradient(place, DT, axis=0)
    r, v, found = place[0], speed[0], []
    for at, wanted in zip(place, speed, strict=True):
        found.append(r)
        off = at - r
        distance = max(float(np.linalg.norm(off)), 1e-9)
        a = GAIN * (wanted + min(0.5 * GAIN, np.sqrt(limit / distance)) * off - v)
        v = v + DT * a * min(1.0, limit / max(float(np.linalg.norm(a)), 1e-9))
        r = r + DT * v
    return np.array(found)


def blurred(x: Array, seconds: float) -> Array:
    """The mean of x (N,) over so many seconds about each time: corners become curves."""
    half = max(1, round(seconds / DT / 2))
    return np.convolve(np.pad(x, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")


def wobble(seed: int, name: str, process: GaussMarkov, samples: int, unit: float = 1.0) -> Array:
    """A Gauss-Markov process (N,) from the stream `name` of `seed`; its sigma is in `unit`s."""
    return np.fromiter(islice(gauss_markov(normals(seed, name), process, DT, unit), samples), float, samples)
