"""The array types of the sensors, and a test of times against fault intervals."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def within(t: Array, intervals: Sequence[tuple[float, float]]) -> Flags:
    """Return which times t (N,) lie in one of the intervals [from, to), s."""
    inside = np.zeros(t.shape, bool)
    for begin, end in intervals:
        inside |= (t >= begin) & (t < end)
    return inside
