"""Noise of our sensors, learnt from their messages by the measure of `onboard.ownship.scatter`.

The assumed noise holds until enough messages have arrived. Implausibly low
noise is not learnt: it is a mistake, as of units. Position keeps the accuracy that the receiver reports: most of
its error changes slowly, so its scatter does not show it.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.own_state.config import Config
from onboard.ownship.contradictions import MAX_SPEED_NOISE, RATE_NOISE
from onboard.ownship.scatter import Scatter, VelocityNoise
from onboard.units import S_PER_NS

# rad; quantisation of MAVLink's quaternions and the autopilot's timing
MIN_ATTITUDE_SIGMA: Final = np.radians(0.02)
MIN_RATE_SIGMA: Final = np.radians(0.2)  # rad/s
KNOWN_TORQUE_NOISE: Final = 0.2  # rad/s^2 per square root of Hz, assumed where motors' torques are known
UNKNOWN_TORQUE_NOISE: Final = 2.0  # the same elsewhere
MIN_TURNING_NOISE: Final = 0.05  # rad/s^2 per square root of Hz
# m/s: a course in centidegrees at 10 m/s moves velocity by 2 mm/s, the receiver's delay more
MIN_SPEED_SIGMA: Final = 0.03
NO_NOISE: Final = (0.0, 0.0, 0.0)
MAX_SAMPLE_INTERVAL_NS: Final = 500_000_000  # between compared samples
MIN_INCREMENT_COUNT: Final = 50  # Fewer increments leave the assumed noise in use.
DENSITY_HISTORY_LENGTH: Final = 600  # for late measurements


class Densities:
    """Spectral densities (3,) as they were known at increasing times."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._values: list[Array] = []

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest value."""
        return self._times[-1] if self._times else None

    def add(self, t_ns: int, value: Array) -> None:
        """Append the value known from a time on."""
        self._times.append(t_ns)
        self._values.append(value)
        if len(self._times) > 2 * DENSITY_HISTORY_LENGTH:
            del self._times[:-DENSITY_HISTORY_LENGTH], self._values[:-DENSITY_HISTORY_LENGTH]

    def at(self, t_ns: int) -> Array | None:
        """Return the value known at a time; None before the first."""
        i = bisect_right(self._times, t_ns) - 1
        return self._values[i] if i >= 0 else None


class SensorNoise:
    """Standard deviations of attitude, rates and a fix's velocity, and angular noise.

    The angular noise is that of the angular acceleration.
    """

    def __init__(self, config: Config) -> None:
        self._attitude = np.radians(config.attitude_sigma_deg)
        self._rates = np.full(3, np.radians(config.rates_sigma_deg_s))
        self._speed = np.array(config.gps_velocity_sigma_m_s)
        known = UNKNOWN_TORQUE_NOISE if config.airframe == "unknown" else KNOWN_TORQUE_NOISE
        self._turning = np.full(3, known**2)
        self._scatter, self._speeds = Scatter(3), VelocityNoise(2, MAX_SAMPLE_INTERVAL_NS)
        self._last: tuple[int, Array] | None = None
        self._densities = Densities()

    def add_rates(self, t_ns: int, omega: Array, acceleration: Array | None) -> None:
        """Add body rates (3,), rad/s, and the mean angular acceleration (3,) since the last.

        The acceleration, rad/s^2, is None if it is unknown.
        """
        last, self._last = self._last, (t_ns, omega)
        if last is None or not 0 < t_ns - last[0] <= MAX_SAMPLE_INTERVAL_NS:
            self._scatter.skip()
            return
        dt = (t_ns - last[0]) * S_PER_NS
        change = omega - last[1] - (0.0 if acceleration is None else acceleration * dt)
        self._scatter.add(change.tolist(), dt)
        if self._scatter.count >= MIN_INCREMENT_COUNT:
            self._densities.add(t_ns, np.maximum(np.array(self._scatter.walk or NO_NOISE), MIN_TURNING_NOISE**2))

    def add_fix(self, t_ns: int, velocity: Array) -> None:
        """Add a fix's velocity in n, (2,) or (3,)."""
        if len(velocity) > 1:
            self._speeds.add(t_ns, velocity[:2].tolist())
        else:
            self._speeds.skip()

    def attitude(self, white: Sequence[float] | None) -> Array:
        """Return standard deviations (6,) of roll, pitch, yaw (rad) and the body rates (rad/s).

        `white`: those of the attitudes, as measured.
        """
        attitude, rates = self._attitude, self._rates
        if white is not None and self._scatter.count >= MIN_INCREMENT_COUNT:
            attitude = np.maximum(np.array(white), MIN_ATTITUDE_SIGMA)
            rates = np.clip(np.array(self._scatter.white or NO_NOISE), MIN_RATE_SIGMA, RATE_NOISE)
        return np.concatenate([attitude, rates])

    @property
    def speed(self) -> Array:
        """Standard deviations (3,) of a fix's velocity, m/s.

        The vertical one keeps its ratio to the horizontal ones.
        """
        white = self._speeds.white
        if white is None or self._speeds.count < MIN_INCREMENT_COUNT:
            return self._speed
        level = min(max(math.hypot(*white) / math.sqrt(2.0), MIN_SPEED_SIGMA), MAX_SPEED_NOISE)
        return np.asarray(self._speed * level / self._speed[0])

    def turning(self, t_ns: int) -> Array:
        """Return the spectral density (3,) of the angular acceleration's noise at a time.

        In (rad/s^2)^2/Hz, as known at that time.
        """
        learned = self._densities.at(t_ns)
        return self._turning if learned is None else learned
