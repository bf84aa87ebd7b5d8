"""What no vehicle does, so that whatever states it is wrong."""

import math
from collections.abc import Sequence
from typing import Final

from onboard.messages import Imu

FASTEST_STATED: Final = 1e4  # m/s
FARTHEST_POSITION: Final = 1e7  # m
QUICKEST_STATED: Final = 1e3  # rad/s
LARGEST_SPECIFIC_FORCE: Final = 1e3  # m/s^2, of a specific force; accelerometers end at a third of it


def is_usable(imu: Imu) -> bool:
    """Whether a vehicle can have moved so. What follows from samples is added up, so a single one that is not a
    number, or as large as any number, would stay in all that comes after it."""
    return within(imu.f_b, LARGEST_SPECIFIC_FORCE) and within(imu.omega_b, QUICKEST_STATED)


def within(values: Sequence[float], limit: float) -> bool:
    """Whether their norm is smaller than the limit; that of anything with a NaN is not."""
    return math.hypot(*values) < limit
