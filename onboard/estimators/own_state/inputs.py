"""What drives our own model between measurements: specific force, and what the motors are told, over the last
seconds. A step is driven by the mean of the samples over it, so that neither their rate nor their phase against
the measurements matters."""

from bisect import bisect_left, bisect_right
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.models.own_motion import GRAVITY

KEPT_NS: Final = 3_000_000_000
HELD_NS: Final = 200_000_000  # a sample stands for so long after it; then nothing is known
NS: Final = 1e-9
DOWN: Final = np.array([0.0, 0.0, 1.0])
SPAN_NS: Final = 900_000_000  # between fixes that are compared, at least and at most
LONGEST_NS: Final = 2_000_000_000
FADING_S: Final = 5.0
UNKNOWN: Final = 4.0  # (m/s^2)^2/Hz, where fixes have not told
KEPT: Final = 100
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


class Manoeuvres:
    """How much the specific force differs from hovering at our attitude, as a density (m/s^2)^2/Hz for the axes of
    b: by how much more the velocity of fixes a second apart changes than attitude tells, whatever an accelerometer
    is worth. No less than what the fixes' noise hides. The largest of late counts, and fades over `FADING_S`."""

    def __init__(self) -> None:
        self._hovering = Samples(3)  # acceleration in n, were the force that of hovering
        self._fixes: list[tuple[int, Array]] = []
        self._times: list[int] = []
        self._found: list[Array] = []

    def add_attitude(self, t_ns: int, R_nb: Array) -> None:
        """The attitude then."""
        self._hovering.add(t_ns, GRAVITY * (DOWN - R_nb[:, 2]))

    def add_fix(self, t_ns: int, velocity: Array, sigma: Array) -> None:
        """A fix's velocity in n, (2,) or (3,), and its noise."""
        self._fixes = [(t, v) for t, v in self._fixes if t_ns - t <= LONGEST_NS and len(v) == len(velocity)]
        before = [(t, v) for t, v in self._fixes if t_ns - t >= SPAN_NS]
        if not self._fixes or t_ns > self._fixes[-1][0]:
            self._fixes.append((t_ns, velocity))
        if not before or len(velocity) < 2:
            return
        t0_ns, v0 = before[-1]
        told = self._hovering.mean(t0_ns, t_ns)
        if told is None or (self._times and t_ns <= self._times[-1]):
            return
        n, span = len(velocity), (t_ns - t0_ns) * NS
        noise = 2 * sigma**2 / span
        excess = np.maximum((velocity - v0 - told[:n] * span) ** 2 / span - noise, noise)
        across = float(excess[:2].max())
        along = float(excess[2]) if n == 3 else UNKNOWN
        last = self.at(t_ns)
        kept = 1.0 if not self._times else float(np.exp(-(t_ns - self._times[-1]) * NS / FADING_S))
        found = np.array([across, across, along])
        self._times.append(t_ns)
        self._found.append(found if len(self._times) == 1 else np.maximum(found, kept * last))
        if len(self._times) > KEPT:
            del self._times[: -KEPT // 2], self._found[: -KEPT // 2]

    def at(self, t_ns: int) -> Array:
        """The density (3,) as known at a time."""
        i = bisect_right(self._times, t_ns) - 1
        return self._found[i] if i >= 0 else np.full(3, UNKNOWN)


class Inputs(NamedTuple):
    """Specific force (3,) of the accelerometer, and angular acceleration (3,) that the motors are to give; and how
    much that force may differ from hovering."""

    force: Samples
    turning: Samples
    manoeuvres: Manoeuvres

    @property
    def nav_times(self) -> list[int]:
        """No nodes but those of measurements (see `_history.Motion`)."""
        return []

    def knows(self, t_ns: int) -> bool:
        """Whether nothing to come can change what drove the model until then."""
        return bool(self.force.times) and t_ns <= self.force.times[-1]
