"""Random sequences, each with its own stream identified by seed and name.

A further sequence, or a message at another rate, leaves all others unchanged.
"""

import math
import zlib
from collections.abc import Iterator
from typing import Final

import numpy as np

from onboard.messages import Vec3
from simlink.scenarios.profiles import GaussMarkov

BLOCK_SIZE: Final = 1024  # numbers drawn at once; one at a time costs ten times as much


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the stream `name` of `seed` (>= 0).

    Drawn as one array, its numbers equal those that `normals` or `uniforms` yield one by one.
    """
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def normals(seed: int, name: str) -> Iterator[float]:
    """Yield independent N(0, 1) numbers of the stream `name` of `seed` (>= 0), without end."""
    rng = stream(seed, name)
    while True:
        yield from rng.standard_normal(BLOCK_SIZE).tolist()


def uniforms(seed: int, name: str) -> Iterator[float]:
    """Yield independent numbers, uniform in [0, 1), of the stream `name` of `seed` (>= 0)."""
    rng = stream(seed, name)
    while True:
        yield from rng.random(BLOCK_SIZE).tolist()


def gauss_markov(z: Iterator[float], process: GaussMarkov, dt: float, unit: float = 1.0) -> Iterator[float]:
    """Yield a stationary first-order Gauss-Markov process, driven by the normals `z`.

    Samples are `dt` seconds apart; the process's sigma is in `unit`s.
    """
    sigma = process.sigma * unit
    if sigma == 0.0:
        while True:
            yield 0.0
    decay = math.exp(-dt / process.time)
    drive = sigma * math.sqrt(1.0 - decay * decay)
    x = sigma * next(z)
    while True:
        yield x
        x = decay * x + drive * next(z)


def gauss_markov_vectors(
    seed: int, name: str, process: GaussMarkov, dt: float, unit: float = 1.0, third: GaussMarkov | None = None
) -> Iterator[Vec3]:
    """Yield vectors of three independent Gauss-Markov processes.

    They use the streams `name`.x, .y and .z of `seed`; `third` is the process of z if it differs.
    """
    processes = (("x", process), ("y", process), ("z", third or process))
    x, y, z = (gauss_markov(normals(seed, f"{name}.{axis}"), p, dt, unit) for axis, p in processes)
    return zip(x, y, z, strict=True)
