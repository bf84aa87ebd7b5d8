"""A size that becomes known better while a leader is followed: what the states of the filters become by it.

The images alone never correct the size: they show it over the range. What does is elsewhere (`broadcast`).
"""

from typing import NamedTuple

from onboard.arrays import Array
from onboard.models.relative_motion import SIZE


class Size(NamedTuple):
    """The wingspan and its standard deviation, m."""

    value: float
    sigma: float


def with_size(mean: Array, P: Array, size: Size) -> tuple[Array, Array]:
    """Means (..., n) and covariances (..., n, n) with this marginal of the size; all else keeps what it is for a
    given size."""
    variance = P[..., SIZE, SIZE]
    gain = P[..., SIZE] / variance[..., None]
    moved = mean + gain * (size.value - mean[..., SIZE])[..., None]
    outer = gain[..., :, None] * gain[..., None, :]
    return moved, P + outer * (size.sigma**2 - variance)[..., None, None]
