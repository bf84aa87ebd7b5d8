"""Statistics shared by the scores. None without data."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import Record

MAX_ESTIMATE_AGE_S = 0.5  # Older estimates do not count as available.


class Latency(Record, frozen=True, kw_only=True):
    """Latencies in milliseconds.

    Attributes
    ----------
    p50, p99
        Median and 99th percentile from exposure to publication.
    receive_to_publish_p50, receive_to_publish_p99
        The same from reception to publication, our own share of it.
    """

    p50: float | None = None
    p99: float | None = None
    receive_to_publish_p50: float | None = None
    receive_to_publish_p99: float | None = None


def rms(values: ArrayLike) -> float | None:
    """Return the root mean square."""
    squares = np.square(values)
    return float(np.sqrt(np.mean(squares))) if squares.size else None


def percent(hits: ArrayLike) -> float | None:
    """Return the share of true values, %."""
    flags = np.asarray(hits)
    return float(np.mean(flags)) * 100 if flags.size else None


def single_bounds(dof: int) -> tuple[float, float]:
    """Return 95 % bounds of a single chi-square draw with `dof` degrees of freedom."""
    return chi_square_threshold(0.025, dof), chi_square_threshold(0.975, dof)


def availability(samples: Array, times: ArrayLike, valid: ArrayLike) -> Array:
    """Return whether there was a valid estimate at each of the times `samples` (n,).

    The newest of the estimates at `times` (m,), in order, must be `valid` (m,), and at most `MAX_ESTIMATE_AGE_S`
    old. All times in s. Returns (n,) of bool.
    """
    at, is_valid = np.asarray(times, dtype=float), np.asarray(valid, dtype=bool)
    if not at.size:
        return np.zeros(len(samples), dtype=bool)
    newest = np.searchsorted(at, samples, side="right") - 1
    return np.asarray((newest >= 0) & is_valid[newest] & (samples - at[newest] <= MAX_ESTIMATE_AGE_S))


def percentiles(milliseconds: Sequence[float]) -> tuple[float | None, float | None]:
    """Return the median and the 99th percentile."""
    if not milliseconds:
        return None, None
    p50, p99 = np.percentile(np.array(milliseconds), [50, 99])
    return float(p50), float(p99)
