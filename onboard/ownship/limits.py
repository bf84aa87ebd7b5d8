"""Limits that no vehicle exceeds. A message that states more is wrong."""

import math
from collections.abc import Sequence
from typing import Final

from onboard.messages import Imu

MAX_STATED_SPEED: Final = 1e4  # m/s
MAX_STATED_DISTANCE: Final = 1e7  # m
MAX_STATED_RATE: Final = 1e3  # rad/s
MAX_SPECIFIC_FORCE: Final = 1e3  # m/s^2; accelerometers end at a third of it.


def is_usable(imu: Imu) -> bool:
    """Whether a vehicle can have moved as the sample says.

    Samples are summed, so a single NaN or huge value would remain in all later sums."""
    return within(imu.f_b, MAX_SPECIFIC_FORCE) and within(imu.omega_b, MAX_STATED_RATE)


def within(values: Sequence[float], limit: float) -> bool:
    """Whether the norm is smaller than a limit. A norm that is NaN is not."""
    return math.hypot(*values) < limit
