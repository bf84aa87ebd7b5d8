"""Gravity and the time step of the simulated world."""

from typing import Final

from onboard.units import NS_PER_S

GRAVITY: Final = 9.80665  # m/s^2
STEPS_PER_SECOND: Final = 200
STEP_NS: Final = NS_PER_S // STEPS_PER_SECOND
DT: Final = 1.0 / STEPS_PER_SECOND  # s


def step_count(seconds: float) -> int:
    """The whole number of world steps nearest to a duration."""
    return round(seconds * STEPS_PER_SECOND)
