"""Random numbers that are a fixed function of a number.

The same images give the same estimate.

What each of them is for has a stream: a number that is added to that of a step's first draw, `Particles.draws`. A
normal number takes the stream behind its own, too."""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import INT, MAKING, UNSIGNED, kernel

WEYL: Final = np.uint64(0x632BE59BD9B4E019)  # odd, to keep the streams of successive draws apart
MIX: Final = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
SHIFTS: Final = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)

# The streams of a step: so many until the next step's begin, and as many in each series, this far apart.
STREAMS_PER_STEP: Final = 8
STREAM_SPACING: Final = 1 << 40
OF_TURNING, OF_TURN_RATE, _, OF_REGIME, OF_WANDERING, _, OF_RESAMPLED_HEADING, OF_HEADING = map(
    np.uint64, range(STREAMS_PER_STEP)
)
OF_MANOEUVRES, _, OF_BANK, _, OF_WOBBLE, _, OF_TYING, _ = (
    np.uint64(STREAM_SPACING + n) for n in range(STREAMS_PER_STEP)
)
OF_DRAG, OF_ACCEPTANCE, OF_NEW_WOBBLE, OF_SLACK = (np.uint64(n * STREAM_SPACING) for n in range(2, 6))
OF_INTENSITIES: Final = OF_MANOEUVRES, OF_BANK, OF_WOBBLE

# Those of a new particles, beside OF_TURNING, OF_TURN_RATE and OF_REGIME. Its first step, which begins at 4, draws
# some of these numbers again for other ends.
OF_FIRST_HOVERING, *firsts = (np.uint64(STREAM_SPACING + n) for n in range(11))
OF_FIRST_MANOEUVRES, _, OF_FIRST_BANK, _, OF_FIRST_WOBBLE, _, OF_FIRST_SIZE, _, OF_FIRST_DRAG, _ = firsts
OF_FIRST_INTENSITIES: Final = OF_FIRST_MANOEUVRES, OF_FIRST_BANK, OF_FIRST_WOBBLE


def uniform(draw: int | np.uint64, count: int) -> Array:
    """Numbers (count,) in (0, 1), a fixed function of `draw`, by the generator splitmix64."""
    found: Array = _uniforms(draw, count)
    return found


def normal(draw: int | np.uint64, count: int) -> Array:
    """Standard normal numbers (count,), a fixed function of `draw` and `draw + 1`, by Box and Muller."""
    found: Array = _normals(draw, count)
    return found


@kernel(**MAKING)
def uniform_of(draw, k):
    """The number of place k in `uniform`, to be called from compiled code."""
    z = np.uint64(draw) * WEYL + np.uint64(k + 1)
    z *= MIX[0]
    z = (z ^ (z >> SHIFTS[0])) * MIX[1]
    z = (z ^ (z >> SHIFTS[1])) * MIX[2]
    z ^= z >> SHIFTS[2]
    return (np.float64(z >> SHIFTS[3]) + 0.5) * 2.0**-53


@kernel(**MAKING)
def normal_of(draw, k):
    """The number of place k in `normal`, to be called from compiled code."""
    angle = 2.0 * math.pi * uniform_of(np.uint64(draw + 1), k)
    return np.sqrt(-2.0 * np.log(uniform_of(draw, k))) * np.cos(angle)


@kernel((UNSIGNED, INT), **MAKING)
def _uniforms(draw, count):
    found = np.empty(count)
    for k in range(count):
        found[k] = uniform_of(draw, k)
    return found


@kernel((UNSIGNED, INT), **MAKING)
def _normals(draw, count):
    found = np.empty(count)
    for k in range(count):
        found[k] = normal_of(draw, k)
    return found
