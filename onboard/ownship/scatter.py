"""Noise of a stream, learnt from the stream itself.

The values of a stream at two times should differ by the integral of its own rates. The remaining difference, an
increment e, shows the noise by its autocovariance. White noise of standard deviation r in the stated values makes
c0 = 2 r^2 and c1 = -r^2, since each value enters two increments in a row, with opposite signs. A random walk that
gains w each step makes c0 = w and c1 = 0. So r^2 = -c1 and w = c0 + 2 c1, and a sum over m steps has the variance
m w + 2 r^2.

The mean is subtracted, since a constant contradiction is no noise. Increments are limited to a few standard
deviations, so that single wrong values count little; the first ones are limited by each other, as a stream may
begin with a jump. More noise than any such sensor has (`Ceiling`) is a mistake, for example of units.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from onboard.units import S_PER_NS

AVERAGING_TIME_S: Final = 5.0  # of covariances
MIN_INCREMENT_COUNT: Final = 10  # With fewer, the noise is unknown and no increment is limited.
MAX_INCREMENT_SIGMAS: Final = 4.0
MAX_OUTLIER_COUNT: Final = 2  # among the first increments


class Ceiling(NamedTuple):
    """The most noise that a stream may have."""

    white: float = math.inf  # standard deviation of the values
    walk: float = math.inf  # variance that the random walk gains in a second


class Scatter:
    """Running autocovariance of increments of `size` components, per component."""

    def __init__(self, size: int) -> None:
        self.count = 0
        self._mean = [0.0] * size
        self._c0 = [0.0] * size
        self._c1 = [0.0] * size
        self._dt = 0.0  # mean
        self._last: list[float] | None = None  # about the mean, limited
        # The first increments, each with dt and whether it continues the one before; None once they are used.
        self._first: list[tuple[Sequence[float], float, bool]] | None = []
        self._follows = True

    def add(self, e: Sequence[float], dt: float) -> None:
        """Add the increment (size,) over a step of dt seconds."""
        if self._first is None:
            self._add(e, dt)
            return
        self._first.append((e, dt, self._follows))
        self._follows = True
        if len(self._first) == MIN_INCREMENT_COUNT:
            first, self._first = self._first, None
            columns = [_limited(values) for values in zip(*[e for e, _, _ in first], strict=True)]
            for values, (_, step, follows) in zip(zip(*columns, strict=True), first, strict=True):
                self._last = self._last if follows else None
                self._add(values, step)

    def _add(self, e: Sequence[float], dt: float) -> None:
        self.count += 1
        share = max(1.0 / self.count, min(dt / AVERAGING_TIME_S, 1.0))
        mean, c0, c1, now, last = self._mean, self._c0, self._c1, list[float](), self._last
        self._dt += share * (dt - self._dt)
        is_limited = self.count > MIN_INCREMENT_COUNT
        for i, value in enumerate(e):
            off = value - mean[i]
            if is_limited:
                most = MAX_INCREMENT_SIGMAS * math.sqrt(c0[i])
                if off > most:
                    off = most
                elif off < -most:
                    off = -most
            mean[i] += share * off
            c0[i] += share * (off * off - c0[i])
            if last is not None:
                c1[i] += share * (off * last[i] - c1[i])
            now.append(off)
        self._last = now

    def skip(self) -> None:
        """Separate the next increment from the last one."""
        self._last, self._follows = None, False

    @property
    def white(self) -> tuple[float, ...] | None:
        """Standard deviations (size,) of the values' white noise; None before they are known."""
        if self.count < MIN_INCREMENT_COUNT:
            return None
        return tuple([math.sqrt(max(-c, 0.0)) for c in self._c1])

    @property
    def walk(self) -> tuple[float, ...] | None:
        """Variances (size,) that the random walk gains in a second; None before they are known."""
        if self.count < MIN_INCREMENT_COUNT:
            return None
        return tuple([max(a + 2.0 * b, 0.0) / self._dt for a, b in zip(self._c0, self._c1, strict=True)])

    def exceeds(self, ceiling: Ceiling) -> bool:
        """Whether there is more noise than the stream can have."""
        if self.count < MIN_INCREMENT_COUNT:
            return False
        white, walk, dt = ceiling.white, ceiling.walk, self._dt
        for a, b in zip(self._c0, self._c1, strict=True):
            if b < 0.0 and math.sqrt(-b) > white:
                return True
            if (gained := a + 2.0 * b) > 0.0 and gained / dt > walk:
                return True
        return False

    def deviation(self, steps: int) -> float:
        """Return the standard deviation of the length of a sum of increments; 0 if unknown."""
        if self.count < MIN_INCREMENT_COUNT:
            return 0.0
        walk = white = 0.0
        for a, b in zip(self._c0, self._c1, strict=True):
            if (gained := a + 2.0 * b) > 0.0:
                walk += gained
            if b < 0.0:
                white -= b
        return math.sqrt(steps * walk + 2.0 * white)


class VelocityNoise:
    """White noise of a stream of velocities, from their second differences.

    White noise of standard deviation r makes an autocovariance of -4 r^2 at lag 1; an acceleration that changes
    smoothly makes none, or a positive one.
    """

    def __init__(self, size: int, max_interval_ns: int) -> None:
        self._max_interval_ns = max_interval_ns
        self._scatter = Scatter(size)
        self._last: tuple[int, Sequence[float]] | None = None
        self._slope: list[float] | None = None  # from the velocity before to the last one

    @property
    def count(self) -> int:
        """Number of second differences."""
        return self._scatter.count

    @property
    def white(self) -> tuple[float, ...] | None:
        """Standard deviations (size,), m/s; None before they are known."""
        white = self._scatter.white
        return None if white is None else tuple([0.5 * sigma for sigma in white])

    def add(self, t_ns: int, velocity: Sequence[float]) -> None:
        """Add a velocity (size,), m/s."""
        last, self._last = self._last, (t_ns, velocity)
        if last is None or not 0 < t_ns - last[0] <= self._max_interval_ns:
            self._slope = None
            self._scatter.skip()
            return
        dt = (t_ns - last[0]) * S_PER_NS
        before, self._slope = self._slope, [(b - a) / dt for a, b in zip(last[1], velocity, strict=True)]
        if before is not None:
            self._scatter.add([(b - a) * dt for a, b in zip(before, self._slope, strict=True)], dt)

    def skip(self) -> None:
        """Separate the next velocity from the last one."""
        self._last = None


def _limited(values: Sequence[float]) -> Sequence[float]:
    """Limit a component's first increments, up to `MAX_OUTLIER_COUNT` of them outliers."""
    middle = sorted(values)[len(values) // 2]
    most = MAX_INCREMENT_SIGMAS * sorted([abs(value - middle) for value in values])[-1 - MAX_OUTLIER_COUNT]
    return [min(max(value, middle - most), middle + most) for value in values] if most else values
