"""Alternate timing, A B A B ..., and the median of the pairs' ratios.

A busy machine thus slows both alike.
"""

from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np

Run = Callable[[int], object]  # makes so many steps, each a prediction and an update


class Side(NamedTuple):
    """One side of a comparison: `run(steps)`, each step of which advances `filters` filters."""

    run: Run
    steps: int  # in one call
    filters: int = 1


class Ratio(NamedTuple):
    """Medians of microseconds per filter and step, and of peer / ours with its quartiles."""

    ours_us: float
    peer_us: float
    times: float
    low: float
    high: float


def compare(ours: Side, peer: Side, pairs: int) -> Ratio:
    """Time `pairs` pairs, after one of each that is not counted."""
    rows = np.array([(_time(ours), _time(peer)) for _ in range(pairs + 1)])[1:]
    low, times, high = np.quantile(rows[:, 1] / rows[:, 0], [0.25, 0.5, 0.75])
    ours_us, peer_us = np.median(rows, axis=0)
    return Ratio(float(ours_us), float(peer_us), float(times), float(low), float(high))


def _time(side: Side) -> float:
    start = perf_counter()
    side.run(side.steps)
    return (perf_counter() - start) / (side.steps * side.filters) * 1e6
