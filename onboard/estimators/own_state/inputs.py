"""Inputs of our own model over the last seconds.

They are the specific force, and the angular acceleration by the motors. A step is driven by the mean of the
samples over it, so that neither their rate nor their phase against the measurements matters.
"""

from bisect import bisect_left, bisect_right
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.own_state.noise import Densities, SensorNoise
from onboard.models.own_motion import GRAVITY
from onboard.units import NS_PER_S, S_PER_NS

HISTORY_LENGTH_NS: Final = 3 * NS_PER_S
MAX_HOLD_TIME_NS: Final = 200_000_000  # of a sample; after that the input is unknown
DOWN: Final = np.array([0.0, 0.0, 1.0])
MIN_FIX_INTERVAL_NS: Final = 900_000_000  # between compared fixes
MAX_FIX_INTERVAL_NS: Final = 2 * NS_PER_S  # between compared fixes
MANOEUVRE_DECAY_TIME_S: Final = 5.0
UNKNOWN_DENSITY: Final = 4.0  # (m/s^2)^2/Hz, before fixes have been compared
SCATTER_AVERAGING_TIME_S: Final = 1.0


class Samples:
    """Vectors (n,) at increasing times, with their mean over any span and their scatter.

    The scatter is taken about a smooth course: on a shaking vehicle, sparse samples of an accelerometer scatter by
    many times its own noise. A gap is a longer time without samples than a sample is held; nothing is known within
    it.
    """

    def __init__(self, size: int) -> None:
        self.times: list[int] = []
        self._values: list[Array] = []
        self._sums: list[Array] = []  # integrals up to each sample
        self._scatter: list[Array] = []  # variance of a sample times the time between samples
        self._gaps: list[int] = []  # number of gaps before each sample
        self._size = size

    def add(self, t_ns: int, value: Array) -> bool:
        """Append a sample. Returns False if it is not newer than the newest one."""
        if self.times and t_ns <= self.times[-1]:
            return False
        integral, gaps = np.zeros(self._size), 0
        if self.times:
            dt_ns = t_ns - self.times[-1]
            gaps = self._gaps[-1] + (dt_ns > MAX_HOLD_TIME_NS)
            integral = self._sums[-1] + 0.5 * dt_ns * S_PER_NS * (self._values[-1] + value)
        self._scatter.append(self._mean_scatter(t_ns, value))
        self._gaps.append(gaps)
        self.times.append(t_ns)
        self._values.append(value)
        self._sums.append(integral)
        if self.times[-1] - self.times[0] > 2 * HISTORY_LENGTH_NS:
            keep = bisect_left(self.times, self.times[-1] - HISTORY_LENGTH_NS)
            for kept in (self.times, self._values, self._sums, self._scatter, self._gaps):
                del kept[:keep]
        return True

    def mean(self, t0_ns: int, t1_ns: int) -> Array | None:
        """Return the mean over [t0, t1], holding the newest sample beyond itself.

        None if no sample is near enough, or if a part of the interval is in a gap.
        """
        if not self.times or t0_ns < self.times[0] - MAX_HOLD_TIME_NS or t1_ns > self.times[-1] + MAX_HOLD_TIME_NS:
            return None
        before = max(bisect_right(self.times, t0_ns) - 1, 0)  # the last sample until t0, and the first from t1 on
        after = min(bisect_left(self.times, t1_ns), len(self.times) - 1)
        if self._gaps[after] > self._gaps[before]:
            return None
        if t1_ns - t0_ns < 1:
            return self._at(t0_ns)
        return np.asarray((self._integral(t1_ns) - self._integral(t0_ns)) / ((t1_ns - t0_ns) * S_PER_NS))

    def density(self, t_ns: int) -> Array:
        """Return the spectral density (n,) of the scatter as white noise, as known at a time.

        In unit^2/Hz.
        """
        if not self._scatter:
            return np.zeros(self._size)
        return self._scatter[max(bisect_right(self.times, t_ns) - 1, 0)]

    def _mean_scatter(self, t_ns: int, value: Array) -> Array:
        """Return the running mean of a sample's variance times the interval.

        A sample's deviation from the line through its neighbours has 3/2 of the variance of white noise.
        """
        if len(self.times) < 2:
            return np.zeros(self._size)
        if max(t_ns - self.times[-1], self.times[-1] - self.times[-2]) > MAX_HOLD_TIME_NS:
            return self._scatter[-1]  # a change during a gap is not scatter
        dt = 0.5 * (t_ns - self.times[-2]) * S_PER_NS
        deviation = self._values[-1] - 0.5 * (self._values[-2] + value)
        share = min(dt / SCATTER_AVERAGING_TIME_S, 1.0)
        return self._scatter[-1] + share * (deviation**2 / 1.5 * dt - self._scatter[-1])

    def _at(self, t_ns: int) -> Array:
        i = bisect_right(self.times, t_ns) - 1
        if i < 0 or i + 1 == len(self.times):
            return self._values[max(i, 0)]
        part = (t_ns - self.times[i]) / (self.times[i + 1] - self.times[i])
        return self._values[i] + part * (self._values[i + 1] - self._values[i])

    def _integral(self, t_ns: int) -> Array:
        i = max(bisect_right(self.times, t_ns) - 1, 0)
        dt = (t_ns - self.times[i]) * S_PER_NS
        return self._sums[i] + 0.5 * dt * (self._values[i] + self._at(t_ns)) if dt else self._sums[i]


class Manoeuvres:
    """Spectral density of the specific force's deviation from hovering at our attitude.

    In (m/s^2)^2/Hz, for the axes of b. It is the change of velocity between fixes a second apart that the attitude
    does not explain, so it does not depend on the accelerometer. Its minimum is set by the fixes' own noise. The
    largest recent value counts, and decays with `MANOEUVRE_DECAY_TIME_S`.
    """

    def __init__(self) -> None:
        self._hovering = Samples(3)  # acceleration in n for the specific force of hovering
        self._fixes: list[tuple[int, Array]] = []
        self._densities = Densities()

    def add_attitude(self, t_ns: int, R_nb: Array) -> None:
        """Add the attitude at a time."""
        self._hovering.add(t_ns, GRAVITY * (DOWN - R_nb[:, 2]))

    def add_fix(self, t_ns: int, velocity: Array, sigma: Array) -> None:
        """Add a fix's velocity in n, (2,) or (3,), and its standard deviations."""
        self._fixes = [
            (t, v) for t, v in self._fixes if t_ns - t <= MAX_FIX_INTERVAL_NS and len(v) == len(velocity)
        ]
        earlier = [(t, v) for t, v in self._fixes if t_ns - t >= MIN_FIX_INTERVAL_NS]
        if not self._fixes or t_ns > self._fixes[-1][0]:
            self._fixes.append((t_ns, velocity))
        if not earlier or len(velocity) < 2:
            return
        t0_ns, v0 = earlier[-1]
        hovering = self._hovering.mean(t0_ns, t_ns)
        newest_ns = self._densities.newest_ns
        if hovering is None or (newest_ns is not None and t_ns <= newest_ns):
            return
        n, span = len(velocity), (t_ns - t0_ns) * S_PER_NS
        noise = 2 * sigma**2 / span
        excess = np.maximum((velocity - v0 - hovering[:n] * span) ** 2 / span - noise, noise)
        across = float(excess[:2].max())
        along = float(excess[2]) if n == 3 else UNKNOWN_DENSITY
        density = np.array([across, across, along])
        if newest_ns is not None:
            fading = float(np.exp(-(t_ns - newest_ns) * S_PER_NS / MANOEUVRE_DECAY_TIME_S))
            density = np.maximum(density, fading * self.at(t_ns))
        self._densities.add(t_ns, density)

    def at(self, t_ns: int) -> Array:
        """Return the density (3,) as known at a time."""
        known = self._densities.at(t_ns)
        return np.full(3, UNKNOWN_DENSITY) if known is None else known


class Inputs:
    """Inputs of the model, a `history.Motion`.

    Attributes
    ----------
    noise
        Noise of the sensors.
    force
        The accelerometer's specific force (3,).
    angular_acceleration
        Angular acceleration (3,) by the motors' commands.
    manoeuvres
        How much the force may differ from hovering.
    """

    def __init__(self, noise: SensorNoise) -> None:
        self.noise = noise
        self.force = Samples(3)
        self.angular_acceleration = Samples(3)
        self.manoeuvres = Manoeuvres()

    @property
    def nav_times(self) -> list[int]:
        """No times: nodes exist at measurements only."""
        return []

    def knows(self, t_ns: int) -> bool:
        """Return whether no later sample can change the inputs until then."""
        return bool(self.force.times) and t_ns <= self.force.times[-1]
