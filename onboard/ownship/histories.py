"""Histories of our own attitude, position and velocity, with interpolation.

Velocity is linear between two samples, so the acceleration over a step is exactly the velocity's difference:
integrated, it gives the velocity back, and no accelerometer bias can separate the two.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.messages import Quaternion, Vec3
from onboard.ownship.turning import between, turned
from onboard.units import NS_PER_S, S_PER_NS

HISTORY_DURATION_NS: Final = 5 * NS_PER_S
ZERO_RATES: Final = (0.0, 0.0, 0.0)
MAX_GAP_DURATION_NS: Final = 1_500_000_000  # Pose and velocity are unknown in a longer gap between two samples.


class NavSample(NamedTuple):
    """Position from O and velocity of F, in n. An unknown horizontal position is NaN."""

    r: Vec3
    v: Vec3


class AttitudeSample(NamedTuple):
    """Attitude, body rates, and the attitude's noise."""

    q: Quaternion
    omega: Vec3  # rad/s
    noise: Vec3  # standard deviations of the white noise about b's axes, rad


class Step(NamedTuple):
    """A step between navigation samples, in n."""

    dt: float  # s
    v0: Array  # velocity of F at the start
    v1: Array  # and at the end
    a: Array  # constant acceleration


class Attitudes:
    """Attitudes by time, extrapolated briefly after the newest sample by its rates."""

    def __init__(self, max_extrapolation_ns: int) -> None:
        self.times: list[int] = []
        self._samples: list[AttitudeSample] = []
        self._max_extrapolation_ns = max_extrapolation_ns

    def append(self, t_ns: int, sample: AttitudeSample) -> None:
        """Take a sample that is newer than the newest."""
        self.times.append(t_ns)
        self._samples.append(sample)
        _trim(self.times, self._samples)

    def between(self, from_ns: int, to_ns: int) -> tuple[list[int], list[AttitudeSample]]:
        """The samples between two times, and one more on either side."""
        return _slice(self.times, self._samples, from_ns, to_ns)

    def at(self, t_ns: int) -> AttitudeSample | None:
        """Return the attitude at a time; None where it is not known."""
        times = self.times
        i = bisect_left(times, t_ns)
        if i == len(times):
            if not times or t_ns - times[-1] > self._max_extrapolation_ns:
                return None
            q, omega, noise = self._samples[-1]
            return AttitudeSample(turned(q, omega, (t_ns - times[-1]) * S_PER_NS), omega, noise)
        if times[i] == t_ns:
            return self._samples[i]
        if i == 0 or times[i] - times[i - 1] > MAX_GAP_DURATION_NS:
            return None
        fraction = (t_ns - times[i - 1]) / (times[i] - times[i - 1])
        before, after = self._samples[i - 1], self._samples[i]
        (a, b, c), (a1, b1, c1), left = before.omega, after.omega, 1.0 - fraction
        omega = left * a + fraction * a1, left * b + fraction * b1, left * c + fraction * c1
        return AttitudeSample(between(before.q, after.q, fraction), omega, after.noise)


class Navigation:
    """Positions and velocities by time, extrapolated briefly after the newest sample."""

    def __init__(self, max_extrapolation_ns: int) -> None:
        self.times: list[int] = []
        self._samples: list[NavSample] = []
        self._slopes: list[Vec3] = []  # of the velocity, between each sample and the next
        self._max_extrapolation_ns = max_extrapolation_ns

    def append(self, t_ns: int, sample: NavSample) -> None:
        """Take a sample that is newer than the newest."""
        if self._samples:
            dt, (u0, v0, w0), (u1, v1, w1) = (t_ns - self.times[-1]) * S_PER_NS, self._samples[-1].v, sample.v
            self._slopes.append(((u1 - u0) / dt, (v1 - v0) / dt, (w1 - w0) / dt))
        self.times.append(t_ns)
        self._samples.append(sample)
        _trim(self.times, self._samples)
        del self._slopes[: len(self._slopes) - len(self._samples) + 1]

    def between(self, from_ns: int, to_ns: int) -> tuple[list[int], list[NavSample]]:
        """The samples between two times, and one more on either side."""
        return _slice(self.times, self._samples, from_ns, to_ns)

    def at(self, t_ns: int) -> NavSample | None:
        """Return position and velocity at a time; None where they are not known."""
        times = self.times
        if not times or t_ns < times[0] or t_ns - times[-1] > self._max_extrapolation_ns:
            return None
        i = max(bisect_right(times, t_ns) - 1, 0)
        ahead = (t_ns - times[i]) * S_PER_NS
        near = self._samples[i]
        a = self.slope(i)
        if i + 1 < len(times):
            if times[i] < t_ns and times[i + 1] - times[i] > MAX_GAP_DURATION_NS:
                return None
            fraction = (t_ns - times[i]) / (times[i + 1] - times[i])
            x, y, z = [p + fraction * (q - p) for p, q in zip(near.r, self._samples[i + 1].r, strict=True)]
        else:
            half = 0.5 * ahead
            x, y, z = [p + ahead * (v + half * b) for p, v, b in zip(near.r, near.v, a, strict=True)]
        return NavSample((x, y, z), _accelerated(near.v, a, ahead))

    def cut(self, t0_ns: int, t1_ns: int) -> Iterator[Step]:
        """Divide the way from t0 to t1 at every sample between."""
        times = self.times
        i = bisect_right(times, t0_ns) - 1  # the last sample before t0
        while t0_ns < t1_ns:
            end_ns = min(times[i + 1], t1_ns) if i + 1 < len(times) else t1_ns
            dt, near = (end_ns - t0_ns) * S_PER_NS, max(i, 0)
            slope = self.slope(i)
            v0 = _accelerated(self._samples[near].v, slope, (t0_ns - times[near]) * S_PER_NS)
            yield Step(dt, np.array(v0), np.array(_accelerated(v0, slope, dt)), np.array(slope))
            i, t0_ns = i + 1, end_ns

    def slope(self, i: int) -> Vec3:
        """Return the slope of the velocity after sample i, or the nearest slope."""
        return self._slopes[min(max(i, 0), len(self._slopes) - 1)] if self._slopes else ZERO_RATES


def _accelerated(v: Vec3, a: Vec3, dt: float) -> Vec3:
    """Return a velocity after `dt` seconds of an acceleration."""
    return v[0] + dt * a[0], v[1] + dt * a[1], v[2] + dt * a[2]


def _slice(times: list[int], samples: list[Any], from_ns: int, to_ns: int) -> tuple[list[int], list[Any]]:
    first, last = max(bisect_right(times, from_ns) - 1, 0), bisect_left(times, to_ns) + 1
    return times[first:last], samples[first:last]


def _trim(times: list[int], values: list[Any]) -> None:
    """Drop samples that are older than the history, many at a time."""
    if times[-1] - times[0] > 2 * HISTORY_DURATION_NS:
        keep = bisect_left(times, times[-1] - HISTORY_DURATION_NS)
        del times[:keep], values[:keep]
