"""Random sequences. Each has its own stream, identified by seed and name: a further sequence, or a message at
another rate, leaves all the others unchanged."""

import math
import zlib
from collections.abc import Iterator
from typing import Final

import numpy as np

from onboard.messages import Vec3
from simlink.scenarios.profiles import GaussMarkov

BLOCK: Final = 1024  # numbers are drawn in blocks: one at a time costs ten times as much


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator of the stream `name` of `seed` (>= 0). Drawn as one array, its numbers are those that
    `normals` or `uniforms` give one by one."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def normals(seed: int, name: str) -> Iterator[float]:
    """Endless independent N(0, 1) numbers of the stream `name` of `seed` (>= 0)."""
    rng = stream(seed, name)
    while True:
        yield from rng.standard_normal(BLOCK).tolist()


def uniforms(seed: int, name: str) -> Iterator[float]:
    """Endless independent numbers, uniform in [0, 1), of the stream `name` of `seed` (>= 0)."""
    rng = stream(seed, name)
    while True:
        yield from rng.random(BLOCK).tolist()


def gauss_markov(z: Iterator[float], process: GaussMarkov, dt: float, unit: float = 1.0) -> Iterator[float]:
    """Samples `dt` seconds apart of a stationary first-order Gauss-Markov process, driven by the normals `z`; its
    sigma is in `unit`s."""
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
    """Vectors of three independent Gauss-Markov processes, from the streams `name`.x, .y and .z of `seed`.
    `third`: the process of z, if it is another."""
    processes = (("x", process), ("y", process), ("z", third or process))
    x, y, z = (gauss_markov(normals(seed, f"{name}.{axis}"), p, dt, unit) for axis, p in processes)
    return zip(x, y, z, strict=True)
