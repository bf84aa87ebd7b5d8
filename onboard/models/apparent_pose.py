"""What a detector's pose shows of a leader's nose.

The state is that of `models.apparent_wing`. A nose is a
given number of each particle, so a rotation only weighs particles, and turns those round whose nose is where the
tail is.

The rotation of a planar marker has a known ambiguity: its mirror image about the line of sight looks nearly alike.
So a nose is where it was measured with most of the probability, and else at the mirror image, as of a marker that
stands across the forward axis, or anywhere.
"""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.models.apparent_wing import BANK_ERROR

FLIPPED: Final = 0.2  # the probability that a rotation is the mirror image ...
STRAY: Final = 0.02  # ... and that it says nothing


def measure_nose(noses: Array, means: Array, P: Array, nose: float, mirrored: float, sigma: float) -> Array:
    """Logarithms of the likelihoods (K,) of a nose measured at `nose`, or at its mirror image. Noses (K,), means
    (K, N) and covariances (K, N, N) of particles that have it the wrong way round are turned in place: they bank
    to the other side."""
    likely, turned = (_likelihood(noses + way, nose, mirrored, sigma) for way in (0.0, math.pi))
    turns = turned > likely
    noses[turns] += math.pi
    means[turns, BANK_ERROR] *= -1.0
    P[turns, BANK_ERROR, :] *= -1.0
    P[turns, :, BANK_ERROR] *= -1.0
    return np.asarray(np.log(np.maximum(likely, turned)))


def _likelihood(noses: Array, nose: float, mirrored: float, sigma: float) -> Array:
    found = np.full(len(noses), STRAY / (2.0 * math.pi))
    for share, at in ((1.0 - FLIPPED - STRAY, nose), (FLIPPED, mirrored)):
        off = (noses - at + math.pi) % (2.0 * math.pi) - math.pi
        found += share * np.exp(-0.5 * (off / sigma) ** 2) / (math.sqrt(2.0 * math.pi) * sigma)
    return found
