"""ArduCopter's GUIDED on setpoints of position, velocity and acceleration (4.7: `AC_PosControl`).

It brakes and holds until the first setpoint after the mode was entered. A setpoint is carried on with its velocity
and acceleration; after GUID_TIMEOUT without another both are zero, and the vehicle goes back to where it has come.
The path approaches the setpoint with limits of speed, acceleration and jerk. They bound corrections only: the
setpoint's velocity and acceleration are fed forward whole.
"""

import math
from typing import Final, NamedTuple

from onboard.messages import Vec3
from simlink.world.attitude import add, difference
from simlink.world.constants import DT, G
from simlink.world.setpoint_mode import NO_MOTION, SetpointMode, Target, by_axis, limited, scaled


class Limits(NamedTuple):
    """Of a path's corrections: speed (m/s), acceleration (m/s^2), jerk (m/s^3)."""

    speed: float
    acceleration: float
    jerk: float


LEVEL: Final = Limits(10.0, 2.5, 5.0)  # WPNAV_SPEED, WPNAV_ACCEL, PSC_JERK_XY
CLIMB: Final = Limits(2.5, 1.0, 5.0)  # WPNAV_SPEED_UP, WPNAV_ACCEL_Z, PSC_JERK_Z
SINK: Final = Limits(1.5, 1.0, 5.0)  # WPNAV_SPEED_DN
POSITION_GAIN: Final = 1.0  # 1/s, PSC_POSXY_P, PSC_POSZ_P
HORIZONTAL, VERTICAL = (1.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class GuidedMode(SetpointMode):
    """The mode. It is entered without setpoints too, and those before do not count."""

    loiter_mode, setpoint_mode, needs_stream = 5, 4, False
    velocity_gain, integral_gain = (2.0, 2.0, 5.0), (1.0, 1.0, 1.0)  # PSC_VELXY_P, _I, PSC_VELZ_P, PSC_ACCZ_I
    derivative_gain, damps_error = (0.25, 0.25, 0.0), True  # PSC_VELXY_D
    max_lean = G * math.tan(math.radians(30.0))  # ANGLE_MAX
    yaw_gain, max_yaw_rate = 1.0 / 0.15, math.radians(60.0)  # ATC_INPUT_TC, ATC_SLEW_YAW

    def advanced(self, here: Target) -> Target:
        """The path, shaped."""
        path, wanted = here if self.path is None else self.path.carried(), self.target
        if wanted is None:
            return shaped(path, path._replace(v_n=NO_MOTION, a_n=NO_MOTION, yaw_rate=0.0), LEVEL, CLIMB)
        if not self.is_following:
            wanted = wanted._replace(v_n=NO_MOTION, a_n=NO_MOTION, yaw=path.yaw, yaw_rate=0.0)
        self.target = wanted.carried()
        return shaped(path, wanted, LEVEL, SINK if wanted.r_n[2] > path.r_n[2] else CLIMB)

    def velocity(self, path: Target, r_F: Vec3) -> Vec3:
        """The velocity that leads to the path and along it, m/s."""
        off = difference(path.r_n, r_F)
        level = approach(by_axis(off, HORIZONTAL), POSITION_GAIN, LEVEL.acceleration, LEVEL.speed)
        upright = approach(by_axis(off, VERTICAL), POSITION_GAIN, CLIMB.acceleration, CLIMB.speed)
        return add(path.v_n, add(level, upright))


def shaped(path: Target, wanted: Target, level: Limits, upright: Limits) -> Target:
    """The path with the acceleration by which it comes to a target, and with the target's yaw."""
    level_step, upright_step = step(path, wanted, level, HORIZONTAL), step(path, wanted, upright, VERTICAL)
    return Target(path.r_n, path.v_n, add(path.a_n, add(level_step, upright_step)), wanted.yaw, wanted.yaw_rate)


def step(path: Target, wanted: Target, limits: Limits, axes: Vec3) -> Vec3:
    """The change of a path's acceleration in one step of the world, as `AC_PosControl` has it. Half of the limits
    are for the correction of the place."""
    gain = limits.jerk / limits.acceleration
    r, v, a = (by_axis(difference(x, y), axes) for x, y in zip(wanted[:3], path[:3], strict=True))
    v = add(v, approach(r, 0.5 * gain, 0.5 * limits.acceleration, limits.speed))
    return limited(add(a, approach(v, gain, limits.jerk, limits.acceleration)), limits.jerk * DT)


def approach(error: Vec3, gain: float, limit: float, most: float) -> Vec3:
    """A rate that removes an error, at most `most`: `gain` times it, but no faster than a deceleration of `limit`
    can stop. ArduPilot's square-root controller."""
    size, linear = math.hypot(*error), limit / gain**2
    rate = gain * size if size <= linear else math.sqrt(2.0 * limit * (size - 0.5 * linear))
    return scaled(error, min(rate, most) / max(size, 1e-9))
