"""Profiles in time and random errors: the parts that all tables of a scenario share."""

from collections.abc import Iterable
from typing import Annotated

import msgspec

from onboard.messages import NotNegative, Positive, Record

Probability = Annotated[float, msgspec.Meta(ge=0, le=1)]
Rate = Annotated[float, msgspec.Meta(ge=0, le=200)]  # Hz


class Wave(Record, frozen=True, kw_only=True):
    """mean + amplitude sin(2 pi t / period + phase), in the unit of its owner."""

    mean: float = 0.0
    amplitude: float = 0.0
    period: Positive = 20.0  # s
    phase_deg: float = 0.0


class Pulse(Record, frozen=True, kw_only=True):
    """A raised-cosine bump of height `change` from `start` to `end` (s).

    It rises, stays at its height for `hold` seconds and falls; value and slope are continuous.
    """

    start: NotNegative
    end: Positive
    change: float
    hold: NotNegative = 0.0


class Interval(Record, frozen=True, kw_only=True):
    """From `start` until before `end`, seconds of flight."""

    start: NotNegative
    end: Positive


class GaussMarkov(Record, frozen=True, kw_only=True):
    """An exponentially correlated error, its standard deviation in the unit of its owner."""

    sigma: NotNegative = 0.0
    time: Positive = 10.0  # s, the correlation time


def is_within(t: float, intervals: Iterable[Interval]) -> bool:
    """Whether a time (s) lies in one of the intervals."""
    return any(i.start <= t < i.end for i in intervals)
