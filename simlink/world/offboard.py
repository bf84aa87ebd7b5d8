"""PX4's OFFBOARD on setpoints of position, velocity and acceleration (1.17: `PositionControl`).

The mode is entered only while setpoints come. They are flown as they are, and the last one stands where it is.
Velocity and acceleration are fed forward; MPC_XY_VEL_MAX bounds the sum of correction and feed-forward.
COM_OF_LOSS_T after the last setpoint the vehicle is in Hold (COM_OBL_RC_ACT 5), and brakes. OFFBOARD stays the
intended mode: it returns by itself with the next setpoint.
"""

import math
from typing import Final

from onboard.messages import Vec3
from simlink.world.attitude import add, difference
from simlink.world.constants import G
from simlink.world.guided import Limits, shaped
from simlink.world.setpoint_mode import NO_MOTION, SetpointMode, Target, by_axis, limited, scaled

POSITION_GAIN: Final = (0.95, 0.95, 1.0)  # 1/s, MPC_XY_P, MPC_Z_P
MAX_SPEED, MAX_CLIMB, MAX_SINK = 12.0, 3.0, 1.5  # m/s, MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_UP, MPC_Z_VEL_MAX_DN
BRAKING: Final = Limits(MAX_SPEED, 3.0, 4.0)  # MPC_ACC_HOR, MPC_JERK_AUTO


class OffboardMode(SetpointMode):
    """The mode, and Hold after a loss."""

    loiter_mode, setpoint_mode, needs_stream = 3 << 24 | 4 << 16, 6 << 16, True
    velocity_gain, integral_gain = (1.8, 1.8, 4.0), (0.4, 0.4, 2.0)  # MPC_*_VEL_P_ACC, MPC_*_VEL_I_ACC
    derivative_gain, damps_error = (-0.2, -0.2, 0.0), False  # MPC_*_VEL_D_ACC
    max_lean = G * math.tan(math.radians(45.0))  # MPC_TILTMAX_AIR
    yaw_gain, max_yaw_rate = 2.8, math.radians(200.0)  # MC_YAW_P, MC_YAWRATE_MAX

    def advanced(self, here: Target) -> Target:
        """The setpoint, or a path on which the vehicle brakes."""
        if self.target is not None and self.is_following:
            return self.target
        path = here if self.path is None or self.path is self.target else self.path.carried()
        return shaped(path, path._replace(v_n=NO_MOTION, a_n=NO_MOTION), BRAKING, BRAKING)

    def velocity(self, path: Target, r_F: Vec3) -> Vec3:
        """The velocity that leads to the path and along it, m/s."""
        x, y, z = by_axis(difference(path.r_n, r_F), POSITION_GAIN)
        level = first_of((x, y, 0.0), (path.v_n[0], path.v_n[1], 0.0), MAX_SPEED)
        return level[0], level[1], min(max(z + path.v_n[2], -MAX_CLIMB), MAX_SINK)


def first_of(first: Vec3, second: Vec3, most: float) -> Vec3:
    """The sum of two vectors, or, where it is too long, the first and as much of the second as goes with it."""
    if math.hypot(*add(first, second)) <= most or math.hypot(*first) >= most:
        return limited(add(first, second), most) if math.hypot(*first) < most else limited(first, most)
    size = math.hypot(*second)
    along = (first[0] * second[0] + first[1] * second[1]) / size
    share = math.sqrt(along * along + most * most - first[0] ** 2 - first[1] ** 2) - along
    return add(first, scaled(second, share / size))
