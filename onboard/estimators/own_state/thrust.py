"""What a command to the motors is worth, as the battery empties.

A motor that is driven by a voltage gives a thrust in proportion to the square of the voltage. Whatever that leaves
to explain, of voltages that nobody tells and of propellers that wear, is learned from the flight, so slowly that a
load that falls off is still a load that fell off.
"""

from typing import Final

from onboard.units import NS_PER_S

LEARNS_S: Final = 30.0  # a cell loses 1 % of its thrust in this time, at the end of its charge some 5 %
LEAST, MOST = 0.5, 1.5  # times the airframe's thrust; beyond, it is no matter of charge
STEP_S: Final = 0.3  # a longer gap between two comparisons is not made up for
RESTS_NS: Final = 5 * NS_PER_S  # after so long on the ground, load and battery may be others
SETTLES_NS: Final = 2 * NS_PER_S  # so long after the next take-off, what is seen is taken as known
SETTLES_S: Final = 0.3  # time constant of that
PLAUSIBLE: Final = (0.5, 1.2)  # times the full voltage; else the voltage is of another battery


class ThrustScale:
    """`factor`: thrust over what the airframe's constants give. `full_voltage_v`: the voltage for which those
    hold; None for motors whose speed is governed, and where nobody knows."""

    def __init__(self, full_voltage_v: float | None) -> None:
        self._full_v = full_voltage_v
        self._by_voltage = self._learned = 1.0
        self._last_ns: int | None = None
        self._rests_since_ns: int | None = None
        self._has_flown = self._is_new = False
        self._settles_until_ns = 0

    @property
    def factor(self) -> float:
        """By voltage and experience."""
        return self._by_voltage * self._learned

    def receive_voltage(self, voltage_v: float) -> None:
        """The battery's voltage under load, V."""
        if self._full_v is None:
            return
        share = voltage_v / self._full_v
        if PLAUSIBLE[0] <= share <= PLAUSIBLE[1]:
            self._by_voltage = share * share

    def rest(self, t_ns: int) -> None:
        """At `t_ns` the thrust does not carry the vehicle."""
        self._last_ns = None
        if self._rests_since_ns is None:
            self._rests_since_ns = t_ns
        self._is_new = self._is_new or (self._has_flown and t_ns - self._rests_since_ns > RESTS_NS)

    def settles(self, t_ns: int) -> bool:
        """Whether this flight, at `t_ns`, is not the first and has just begun, so that nothing is a fault yet."""
        self._rests_since_ns, self._has_flown = None, True
        if self._is_new:
            self._is_new, self._settles_until_ns = False, t_ns + SETTLES_NS
        return t_ns < self._settles_until_ns

    def learn(self, t_ns: int, ratio: float) -> None:
        """In a flight without a fault, at `t_ns`, the lift is `ratio` times what `factor` explains."""
        dt = 0.0 if self._last_ns is None else (t_ns - self._last_ns) / NS_PER_S
        self._last_ns = t_ns
        if 0.0 < dt <= STEP_S:
            share = dt / (SETTLES_S if t_ns < self._settles_until_ns else LEARNS_S)
            self._learned *= 1.0 + min(share, 1.0) * (ratio - 1.0)
            self._learned = min(max(self._learned, LEAST), MOST)
