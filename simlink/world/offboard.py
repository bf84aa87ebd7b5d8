"""PX4's OFFBOARD on setpoints of position, velocity and acceleration (1.17: `PositionControl`).

The mode is entered only while setpoints arrive. They are not extrapolated. Velocity and acceleration are fed
forward; MPC_XY_VEL_MAX bounds the sum of correction and feed-forward. COM_OF_LOSS_T after the last setpoint the
vehicle is in Hold (COM_OBL_RC_ACT 5) and brakes. OFFBOARD remains the intended mode and resumes with the next
setpoint.
"""

import math
from typing import Final

from onboard.messages import Vec3
from simlink.world.attitude import add, difference
from simlink.world.constants import GRAVITY
from simlink.world.guided import Limits, shape_path
from simlink.world.setpoint_mode import NO_MOTION, SetpointMode, Target, limit_length, scale, scale_axes

POSITION_GAIN: Final = (0.95, 0.95, 1.0)  # 1/s, MPC_XY_P, MPC_Z_P
MAX_SPEED, MAX_CLIMB, MAX_SINK = 12.0, 3.0, 1.5  # m/s, MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_UP, MPC_Z_VEL_MAX_DN
BRAKING_LIMIT: Final = Limits(MAX_SPEED, 3.0, 4.0)  # MPC_ACC_HOR, MPC_JERK_AUTO


class OffboardMode(SetpointMode):
    """The OFFBOARD mode, and Hold after a loss of setpoints."""

    loiter_mode, setpoint_mode, needs_stream = 3 << 24 | 4 << 16, 6 << 16, True
    velocity_gain, integral_gain = (1.8, 1.8, 4.0), (0.4, 0.4, 2.0)  # MPC_*_VEL_P_ACC, MPC_*_VEL_I_ACC
    derivative_gain, damps_error = (-0.2, -0.2, 0.0), False  # MPC_*_VEL_D_ACC
    max_lean = GRAVITY * math.tan(math.radians(45.0))  # MPC_TILTMAX_AIR
    yaw_gain, max_yaw_rate = 2.8, math.radians(200.0)  # MC_YAW_P, MC_YAWRATE_MAX

    def next_target(self, here: Target) -> Target:
        """Return the setpoint, or the next point of a braking path."""
        if self.target is not None and self.is_following:
            return self.target
        path = here if self.path is None or self.path is self.target else self.path.extrapolated()
        return shape_path(path, path._replace(v_n=NO_MOTION, a_n=NO_MOTION), BRAKING_LIMIT, BRAKING_LIMIT)

    def velocity(self, path: Target, r_F: Vec3) -> Vec3:
        """Return the velocity that leads to the path and along it, m/s."""
        x, y, z = scale_axes(difference(path.r_n, r_F), POSITION_GAIN)
        level = prioritized_sum((x, y, 0.0), (path.v_n[0], path.v_n[1], 0.0), MAX_SPEED)
        return level[0], level[1], min(max(z + path.v_n[2], -MAX_CLIMB), MAX_SINK)


def prioritized_sum(first: Vec3, second: Vec3, most: float) -> Vec3:
    """Return the sum of two vectors, limited to `most`; the first one has priority."""
    if math.hypot(*add(first, second)) <= most or math.hypot(*first) >= most:
        return limit_length(add(first, second), most) if math.hypot(*first) < most else limit_length(first, most)
    size = math.hypot(*second)
    along = (first[0] * second[0] + first[1] * second[1]) / size
    share = math.sqrt(along * along + most * most - first[0] ** 2 - first[1] ** 2) - along
    return add(first, scale(second, share / size))
