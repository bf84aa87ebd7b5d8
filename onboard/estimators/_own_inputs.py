"""What drives our own model between measurements: specific force, and what the motors are told, over the last
seconds. A step is driven by the mean of the samples over it, so that neither their rate nor their phase against
the measurements matters."""

from bisect import bisect_left, bisect_right
from typing import Final, NamedTuple

import numpy as np

from onboard.geometry.rotations import Array

KEPT_NS: Final = 3_000_000_000
HELD_NS: Final = 200_000_000  # a sample stands for so long after it; then nothing is known
NS: Final = 1e-9
SCATTER_S: Final = 1.0  # over which the scatter of samples is averaged


class Samples:
    """Vectors (n,) at rising times, their mean over any span, and how much they scatter about a smooth course: of
    an accelerometer on a shaking vehicle, sampled now and then, that is white noise many times its own."""

    def __init__(self, size: int) -> None:
        self.times: list[int] = []
        self._values: list[Array] = []
        self._sums: list[Array] = []  # integral up to each sample
        self._scatter: list[Array] = []  # variance of a sample times the time between samples
        self._size = size

    def add(self, t_ns: int, value: Array) -> bool:
        """Append; False for what is not newer than the newest."""
        if self.times and t_ns <= self.times[-1]:
            return False
        before = np.zeros(self._size)
        if self.times:
            dt = min(t_ns - self.times[-1], HELD_NS) * NS
            before = self._sums[-1] + 0.5 * dt * (self._values[-1] + value)
        self._scatter.append(self._scattered(t_ns, value))
        self.times.append(t_ns)
        self._values.append(value)
        self._sums.append(before)
        if self.times[-1] - self.times[0] > 2 * KEPT_NS:
            keep = bisect_left(self.times, self.times[-1] - KEPT_NS)
            del self.times[:keep], self._values[:keep], self._sums[:keep], self._scatter[:keep]
        return True

    def mean(self, t0_ns: int, t1_ns: int) -> Array | None:
        """Mean over [t0, t1], the newest sample held beyond itself; None where there is none near enough."""
        if not self.times or t0_ns < self.times[0] - HELD_NS or t1_ns > self.times[-1] + HELD_NS:
            return None
        i = bisect_right(self.times, t1_ns)
        if 0 < i < len(self.times) and self.times[i] - self.times[i - 1] > HELD_NS:
            return None  # a hole
        if t1_ns - t0_ns < 1:
            return self._at(t0_ns)
        return np.asarray((self._integral(t1_ns) - self._integral(t0_ns)) / ((t1_ns - t0_ns) * NS))

    def density(self, t_ns: int) -> Array:
        """Density (n,) of the samples' scatter taken as white noise (unit^2/Hz), as known at a time."""
        if not self._scatter:
            return np.zeros(self._size)
        return self._scatter[max(bisect_right(self.times, t_ns) - 1, 0)]

    def _scattered(self, t_ns: int, value: Array) -> Array:
        """Running mean of the variance about the line through a sample's neighbours, 3/2 of a white noise."""
        if len(self.times) < 2:
            return np.zeros(self._size)
        dt = 0.5 * min(t_ns - self.times[-2], 2 * HELD_NS) * NS
        bend = self._values[-1] - 0.5 * (self._values[-2] + value)
        share = min(dt / SCATTER_S, 1.0)
        return self._scatter[-1] + share * (bend**2 / 1.5 * dt - self._scatter[-1])

    def _at(self, t_ns: int) -> Array:
        i = bisect_right(self.times, t_ns) - 1
        if i < 0 or i + 1 == len(self.times):
            return self._values[max(i, 0)]
        part = (t_ns - self.times[i]) / (self.times[i + 1] - self.times[i])
        return self._values[i] + part * (self._values[i + 1] - self._values[i])

    def _integral(self, t_ns: int) -> Array:
        i = max(bisect_right(self.times, t_ns) - 1, 0)
        dt = (t_ns - self.times[i]) * NS
        return self._sums[i] + 0.5 * dt * (self._values[i] + self._at(t_ns))


class Inputs(NamedTuple):
    """Specific force (3,) of the accelerometer, and angular acceleration (3,) that the motors are to give."""

    force: Samples
    turning: Samples

    @property
    def nav_times(self) -> list[int]:
        """No nodes but those of measurements (see `_history.Motion`)."""
        return []

    def knows(self, t_ns: int) -> bool:
        """Whether nothing to come can change what drove the model until then."""
        return bool(self.force.times) and t_ns <= self.force.times[-1]
