"""Uncertainty of the autopilot's attitude, by its own reports.

A PX4 at rest reports constant-position mode. Its yaw is then that of its compass, which its magnetic-field states
leave uncertain by 10 degrees. The yaw becomes known as it accelerates, since GPS shows the direction. Measured on
a PX4 1.17 that states 10 degrees in its first hover: it was 12 off there, 5 off after 15 m^2/s^3 of acceleration,
and 4 after 40. In a hover its tilt is no better than the bias of its accelerometers, for which it allows 0.4 m/s^2
(EKF2_ABL_LIM), so 2.3 degrees.

In flight that PX4 states a tilt of 0.22 degrees, and a leader's direction was off by 0.4 to 1.1 for minutes. With
three times the tilt stated, chosen on two flights, true positions are inside the 95 % ellipsoid for 95 % of six
others (84, 82, 87, 88, 92 and 77 % before, then 91, 96, 97, 100, 100 and 88), the ellipsoid's mean axis a quarter
longer.
"""

import math
from typing import Final

from onboard.messages import EstimatorStatus, Vec3
from onboard.units import NS_PER_S

YAW_SIGMA_AT_REST: Final = math.radians(10.0)  # rad
TILT_TO_YAW_RATIO: Final = 0.23  # of their standard deviations
STATED_TILT_INFLATION: Final = 3.0  # of the tilt's standard deviation that a filter states
YAW_INFORMATION_RATE: Final = 0.0028 / math.radians(1.0) ** 2  # 1/rad^2, by 1 m^2/s^3
MIN_INTERVAL_NS: Final = 500_000_000


class AttitudeUncertainty:
    """Standard deviations of the autopilot's attitude, rad; 0 where it reports none."""

    def __init__(self) -> None:
        self.sigma = self.tilt = 0.0  # yaw; roll and pitch
        self._is_stated = False
        self._information: float | None = None  # 1/rad^2, since it was at rest
        self._before: tuple[int, Vec3] | None = None

    def receive(self, status: EstimatorStatus) -> None:
        """Update with a report."""
        if status.yaw_sigma is not None:
            self.sigma, self.tilt = status.yaw_sigma, STATED_TILT_INFLATION * (status.tilt_sigma or 0.0)
            self._is_stated = True
        elif status.is_at_rest and self._information is None:
            self._information = YAW_SIGMA_AT_REST**-2

    def move(self, t_ns: int, v_n: Vec3) -> None:
        """Update with our own velocity. An acceleration makes the yaw known."""
        if self._is_stated or self._information is None:
            return
        if self._before is None:
            self._before = t_ns, v_n
        dt = (t_ns - self._before[0]) / NS_PER_S
        if dt < MIN_INTERVAL_NS / NS_PER_S:
            return
        change = math.dist(v_n[:2], self._before[1][:2])
        self._before = t_ns, v_n
        if dt < 2.0 * MIN_INTERVAL_NS / NS_PER_S:
            self._information += YAW_INFORMATION_RATE * change * change / dt
        self.sigma = self._information**-0.5
        self.tilt = TILT_TO_YAW_RATIO * self.sigma
