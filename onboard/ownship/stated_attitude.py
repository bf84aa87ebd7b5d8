"""How far the autopilot's attitude may be off, as far as the autopilot says it.

A PX4 at rest reports constant-position mode. Its yaw is then its compass's, which a filter's states for the
magnetic field leave open by 10 degrees, and it becomes known as it accelerates: GPS then shows which way. Measured
on a PX4 1.17 that states 10 degrees in its first hover, where it was 12 off, and was 5 off after 15 m^2/s^3 of
acceleration, 4 after 40. In a hover its tilt is no better than the bias of its accelerometers, of which it
believes up to 0.4 m/s^2 (EKF2_ABL_LIM), so 2.3 degrees.

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
TILT_SHARE: Final = 0.23  # of it, for the tilt
STATED_TILT: Final = 3.0  # times what a filter states of its tilt
INFORMATION: Final = 0.0028 / math.radians(1.0) ** 2  # 1/rad^2, by 1 m^2/s^3
STRIDE_NS: Final = 500_000_000


class AttitudeUncertainty:
    """`sigma`: standard deviation of the autopilot's yaw by what it says, rad, and `tilt` of its roll and pitch; 0
    where it says nothing."""

    def __init__(self) -> None:
        self.sigma = self.tilt = 0.0
        self._is_stated = False
        self._information: float | None = None  # 1/rad^2, since it was at rest
        self._before: tuple[int, Vec3] | None = None

    def receive(self, status: EstimatorStatus) -> None:
        """Take a report."""
        if status.yaw_sigma is not None:
            self.sigma, self.tilt = status.yaw_sigma, STATED_TILT * (status.tilt_sigma or 0.0)
            self._is_stated = True
        elif status.is_at_rest and self._information is None:
            self._information = YAW_SIGMA_AT_REST**-2

    def move(self, t_ns: int, v_n: Vec3) -> None:
        """Take our own velocity at a time: what has accelerated us shows the yaw."""
        if self._is_stated or self._information is None:
            return
        if self._before is None:
            self._before = t_ns, v_n
        dt = (t_ns - self._before[0]) / NS_PER_S
        if dt < STRIDE_NS / NS_PER_S:
            return
        change = math.dist(v_n[:2], self._before[1][:2])
        self._before = t_ns, v_n
        if dt < 2.0 * STRIDE_NS / NS_PER_S:
            self._information += INFORMATION * change * change / dt
        self.sigma = self._information**-0.5
        self.tilt = TILT_SHARE * self.sigma
