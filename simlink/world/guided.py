"""ArduCopter 4.7's GUIDED on position, velocity and acceleration (`AC_PosControl`).

It brakes and holds until the first setpoint after the mode was entered. A setpoint is extrapolated with its
velocity and acceleration; after GUID_TIMEOUT without another both are set to zero, and the vehicle returns to the
extrapolated point. The path approaches the setpoint within limits of speed, acceleration and jerk. They bound
corrections only: velocity and acceleration of the setpoint are fed forward without limits.
"""

import math
from typing import Final, NamedTuple

from onboard.messages import Vec3
from simlink.world.attitude import add, difference
from simlink.world.constants import DT, GRAVITY
from simlink.world.setpoint_mode import NO_MOTION, SetpointMode, Target, limit_length, scale, scale_axes


class Limits(NamedTuple):
    """Limits of a path's corrections: speed (m/s), acceleration (m/s^2), jerk (m/s^3)."""

    speed: float
    acceleration: float
    jerk: float


HORIZONTAL_LIMIT: Final = Limits(10.0, 2.5, 5.0)  # WPNAV_SPEED, WPNAV_ACCEL, PSC_JERK_XY
CLIMB_LIMIT: Final = Limits(2.5, 1.0, 5.0)  # WPNAV_SPEED_UP, WPNAV_ACCEL_Z, PSC_JERK_Z
SINK_LIMIT: Final = Limits(1.5, 1.0, 5.0)  # WPNAV_SPEED_DN
POSITION_GAIN: Final = 1.0  # 1/s, PSC_POSXY_P, PSC_POSZ_P
HORIZONTAL_AXES, VERTICAL_AXIS = (1.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class GuidedMode(SetpointMode):
    """The GUIDED mode; it can be entered without setpoints, and ignores those from before."""

    loiter_mode, setpoint_mode, needs_stream = 5, 4, False
    velocity_gain, integral_gain = (2.0, 2.0, 5.0), (1.0, 1.0, 1.0)  # PSC_VELXY_P, _I, PSC_VELZ_P, PSC_ACCZ_I
    derivative_gain, damps_error = (0.25, 0.25, 0.0), True  # PSC_VELXY_D
    max_lean = GRAVITY * math.tan(math.radians(30.0))  # ANGLE_MAX
    yaw_gain, max_yaw_rate = 1.0 / 0.15, math.radians(60.0)  # ATC_INPUT_TC, ATC_SLEW_YAW

    def next_target(self, here: Target) -> Target:
        """Return the next point of the shaped path."""
        path, wanted = here if self.path is None else self.path.extrapolated(), self.target
        if wanted is None:
            return shape_path(
                path, path._replace(v_n=NO_MOTION, a_n=NO_MOTION, yaw_rate=0.0), HORIZONTAL_LIMIT, CLIMB_LIMIT
            )
        if not self.is_following:
            wanted = wanted._replace(v_n=NO_MOTION, a_n=NO_MOTION, yaw=path.yaw, yaw_rate=0.0)
        self.target = wanted.extrapolated()
        return shape_path(
            path, wanted, HORIZONTAL_LIMIT, SINK_LIMIT if wanted.r_n[2] > path.r_n[2] else CLIMB_LIMIT
        )

    def velocity(self, path: Target, r_F: Vec3) -> Vec3:
        """Return the velocity that leads to the path and along it, m/s."""
        off = difference(path.r_n, r_F)
        level = approach_rate(
            scale_axes(off, HORIZONTAL_AXES), POSITION_GAIN, HORIZONTAL_LIMIT.acceleration, HORIZONTAL_LIMIT.speed
        )
        upright = approach_rate(
            scale_axes(off, VERTICAL_AXIS), POSITION_GAIN, CLIMB_LIMIT.acceleration, CLIMB_LIMIT.speed
        )
        return add(path.v_n, add(level, upright))


def shape_path(path: Target, wanted: Target, level: Limits, upright: Limits) -> Target:
    """Return the path with the acceleration that leads to a target, and with the target's yaw."""
    level_step, upright_step = (
        acceleration_change(path, wanted, level, HORIZONTAL_AXES),
        acceleration_change(path, wanted, upright, VERTICAL_AXIS),
    )
    return Target(path.r_n, path.v_n, add(path.a_n, add(level_step, upright_step)), wanted.yaw, wanted.yaw_rate)


def acceleration_change(path: Target, wanted: Target, limits: Limits, axes: Vec3) -> Vec3:
    """Return the change of a path's acceleration in one step, as in `AC_PosControl`.

    Half of the limits apply to the correction of the position.
    """
    gain = limits.jerk / limits.acceleration
    r, v, a = (scale_axes(difference(x, y), axes) for x, y in zip(wanted[:3], path[:3], strict=True))
    v = add(v, approach_rate(r, 0.5 * gain, 0.5 * limits.acceleration, limits.speed))
    return limit_length(add(a, approach_rate(v, gain, limits.jerk, limits.acceleration)), limits.jerk * DT)


def approach_rate(error: Vec3, gain: float, limit: float, most: float) -> Vec3:
    """Return the limited rate that removes an error (square-root controller).

    It never exceeds `most`, nor the speed from which a deceleration of `limit` can stop.
    """
    size, linear = math.hypot(*error), limit / gain**2
    rate = gain * size if size <= linear else math.sqrt(2.0 * limit * (size - 0.5 * linear))
    return scale(error, min(rate, most) / max(size, 1e-9))
