"""Statistics that the scores share. None where there is nothing to judge by."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from onboard.messages import Record


class Latency(Record, frozen=True, kw_only=True):
    """Milliseconds. `p50`, `p99`: from exposure to publication; `receive_to_publish_*`: our own share of it."""

    p50: float | None = None
    p99: float | None = None
    receive_to_publish_p50: float | None = None
    receive_to_publish_p99: float | None = None


def rms(values: ArrayLike) -> float | None:
    """Root mean square."""
    squares = np.square(values)
    return float(np.sqrt(np.mean(squares))) if squares.size else None


def percent(hits: ArrayLike) -> float | None:
    """How many of these booleans are true, %."""
    flags = np.asarray(hits)
    return float(np.mean(flags)) * 100 if flags.size else None


def percentiles(milliseconds: Sequence[float]) -> tuple[float | None, float | None]:
    """Median and 99th percentile."""
    if not milliseconds:
        return None, None
    p50, p99 = np.percentile(np.array(milliseconds), [50, 99])
    return float(p50), float(p99)
