"""The wind, where our autopilot estimates it.

A fixed wing points its heading along its path through the air.

Without it, a crab cannot be distinguished from another range: all that both do in the image is shorten the wing.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard import messages
from onboard.arrays import Array
from onboard.estimators.leader.assumptions import GUST_SIGMA_M_S, MAX_WIND_SPEED_M_S, WIND_SIGMA_M_S


class Wind(NamedTuple):
    """Velocity of the air over ground (3,), m/s in n, and its standard deviation on each level axis, m/s."""

    velocity: Array
    sigma: float

    @property
    def is_known(self) -> bool:
        """Whether anything is known of it."""
        return math.isfinite(self.sigma)


UNKNOWN: Final = Wind(np.zeros(3), math.inf)


def wind_of(report: messages.Wind) -> Wind | None:
    """The wind about the leader; None for a report of none that there is.

    An autopilot that estimates none sends exactly 0 without an uncertainty: an ArduCopter always, an ArduPlane
    before its first turns."""
    speed = math.hypot(report.north, report.east)
    if not speed < MAX_WIND_SPEED_M_S or (speed == 0.0 and report.sigma is None):
        return None
    sigma = WIND_SIGMA_M_S if report.sigma is None else report.sigma
    return Wind(np.array([report.north, report.east, 0.0]), math.hypot(sigma, GUST_SIGMA_M_S))
