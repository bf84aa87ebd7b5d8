"""Random sequences. Each has its own stream, found by seed and name, so that adding one, or asking for a
message at another rate, leaves all the others as they were."""

import math
import zlib
from collections.abc import Iterator

import numpy as np

BLOCK = 1024  # numbers are drawn in blocks: one at a time costs ten times as much


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator behind the stream `name` of `seed` (>= 0): all of a stream's numbers at once are those that
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


def gauss_markov(z: Iterator[float], sigma: float, time: float, dt: float) -> Iterator[float]:
    """Samples `dt` seconds apart of a stationary first-order Gauss-Markov process: standard deviation
    `sigma`, correlation time `time` (s), driven by the normals `z`."""
    if sigma == 0.0:
        while True:
            yield 0.0
    decay = math.exp(-dt / time)
    drive = sigma * math.sqrt(1.0 - decay * decay)
    x = sigma * next(z)
    while True:
        yield x
        x = decay * x + drive * next(z)
