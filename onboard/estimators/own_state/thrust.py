"""Thrust of the motors for a given command, as the battery empties.

The thrust of a motor driven by a voltage is proportional to the square of the voltage. Other changes, by
unreported voltages and worn propellers, are learnt from the flight, so slowly that a dropped load is still
detected.
"""

from typing import Final

from onboard.units import NS_PER_S

LEARNING_TIME_S: Final = (
    30.0  # A cell loses 1 % of its thrust in this time, and some 5 % at the end of its charge.
)
MIN_THRUST_RATIO, MAX_THRUST_RATIO = 0.5, 1.5  # Beyond these, the charge is not the reason.
MAX_LEARNING_INTERVAL_S: Final = 0.3  # A longer gap counts as this long.
MIN_REST_DURATION_NS: Final = 5 * NS_PER_S  # On the ground for longer, load and battery may be changed.
SETTLING_DURATION_NS: Final = 2 * NS_PER_S  # after take-off, with fast learning
SETTLING_TIME_CONSTANT_S: Final = 0.3  # of the fast learning
PLAUSIBLE_VOLTAGE_RATIOS: Final = (0.5, 1.2)  # of the full voltage; others are of another battery


class ThrustScale:
    """Ratio of the thrust to that of the airframe's constants.

    `full_voltage_v` is the voltage of these constants; None for motors with governed speed, and if it is unknown.
    """

    def __init__(self, full_voltage_v: float | None) -> None:
        self._full_v = full_voltage_v
        self._by_voltage = self._learned = 1.0
        self._last_ns: int | None = None
        self._rests_since_ns: int | None = None
        self._has_flown = self._is_new = False
        self._settles_until_ns = 0

    @property
    def factor(self) -> float:
        """Ratio of the thrust, by voltage and by learning."""
        return self._by_voltage * self._learned

    def receive_voltage(self, voltage_v: float) -> None:
        """Receive the battery's voltage under load, V."""
        if self._full_v is None:
            return
        share = voltage_v / self._full_v
        if PLAUSIBLE_VOLTAGE_RATIOS[0] <= share <= PLAUSIBLE_VOLTAGE_RATIOS[1]:
            self._by_voltage = share * share

    def rest(self, t_ns: int) -> None:
        """Update with a thrust that does not carry the vehicle at `t_ns`."""
        self._last_ns = None
        if self._rests_since_ns is None:
            self._rests_since_ns = t_ns
        self._is_new = self._is_new or (self._has_flown and t_ns - self._rests_since_ns > MIN_REST_DURATION_NS)

    def is_settling(self, t_ns: int) -> bool:
        """Return whether a later flight has just begun at `t_ns`, so that nothing is a fault yet."""
        self._rests_since_ns, self._has_flown = None, True
        if self._is_new:
            self._is_new, self._settles_until_ns = False, t_ns + SETTLING_DURATION_NS
        return t_ns < self._settles_until_ns

    def learn(self, t_ns: int, ratio: float) -> None:
        """Learn at `t_ns` that the lift is `ratio` times the expected one.

        The flight must be without a fault.
        """
        dt = 0.0 if self._last_ns is None else (t_ns - self._last_ns) / NS_PER_S
        self._last_ns = t_ns
        if 0.0 < dt <= MAX_LEARNING_INTERVAL_S:
            share = dt / (SETTLING_TIME_CONSTANT_S if t_ns < self._settles_until_ns else LEARNING_TIME_S)
            self._learned *= 1.0 + min(share, 1.0) * (ratio - 1.0)
            self._learned = min(max(self._learned, MIN_THRUST_RATIO), MAX_THRUST_RATIO)
