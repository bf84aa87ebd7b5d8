"""The follower flown by an autopilot on SET_POSITION_TARGET_LOCAL_NED.

`GuidedMode` (ArduCopter) and `OffboardMode` (PX4) make a path of setpoints, each in its own way. The position and
velocity control of this module flies it by leaning the body. Before the mode is entered the autopilot is in its
loiter mode, and the follower flies the scenario's slot. From `engage` on the pilot asks for the mode until the
autopilot accepts. The autopilot knows the true state.
"""

import math
from abc import ABC, abstractmethod
from typing import Final, NamedTuple

from onboard.messages import Quaternion, Vec3
from simlink.scenarios.formation import Follow
from simlink.world.attitude import add, difference
from simlink.world.constants import DT
from simlink.world.quadrotor_control import ATTITUDE_GAIN, Controller, Reference

NO_MOTION: Final = (0.0, 0.0, 0.0)
DERIVATIVE_PASS: Final = 1.0 - math.exp(-2.0 * math.pi * 5.0 * DT)  # of 5 Hz: PSC_VELXY_FLTD, MPC_VELD_LP
MAX_INTEGRAL: Final = 10.0  # m/s^2, PSC_VELXY_IMAX
MAX_VERTICAL_ACCELERATION: Final = 5.0  # m/s^2; the craft's motors have twice that


class Target(NamedTuple):
    """A setpoint or a point of a path: place and motion in n (m, m/s, m/s^2), yaw and its rate (rad, rad/s)."""

    r_n: Vec3
    v_n: Vec3
    a_n: Vec3
    yaw: float
    yaw_rate: float = 0.0

    def carried(self) -> "Target":
        """The target after one step of the world."""
        r, v = (
            add(self.r_n, scaled(add(self.v_n, scaled(self.a_n, 0.5 * DT)), DT)),
            add(self.v_n, scaled(self.a_n, DT)),
        )
        return Target(r, v, self.a_n, self.yaw + self.yaw_rate * DT, self.yaw_rate)


class SetpointMode(ABC):
    """The mode, as the pilot of a quadrotor. `begin_ns`: boot time at the start of the flight, from which times
    count here. `is_following`: whether a setpoint is obeyed."""

    loiter_mode: int  # custom_mode of HEARTBEAT, as `setpoint_mode`
    setpoint_mode: int
    needs_stream: bool  # for the mode to be entered, and to stay in it
    velocity_gain: Vec3  # 1/s
    integral_gain: Vec3  # 1/s^2
    derivative_gain: Vec3
    damps_error: bool  # the derivative is that of the velocity's error, and otherwise of the velocity
    max_lean: float  # m/s^2, the horizontal acceleration of the greatest lean
    yaw_gain: float  # 1/s
    max_yaw_rate: float  # rad/s

    def __init__(self, settings: Follow) -> None:
        self.begin_ns = 0
        self.is_entered = self.is_following = False
        self.target: Target | None = None
        self.path: Target | None = None
        self._timeout, self._engage, self._t_target = settings.timeout, settings.engage, -math.inf
        self._controller = Controller(settings.craft, DT)
        self._step = 0
        self._yaw: float | None = None
        self._integral = self._derivative = self._before = NO_MOTION

    @property
    def intended_mode(self) -> int:
        """The mode that the pilot wants, as `custom_mode`."""
        return self.setpoint_mode if self.is_entered else self.loiter_mode

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT's number of the flight mode."""
        return self.loiter_mode if self.needs_stream and not self.is_following else self.intended_mode

    def receive(self, target: Target, t: float) -> None:
        """Take a setpoint that arrives at time `t`, s."""
        if self.is_entered or self.needs_stream:
            self.target, self._t_target = target, t

    @abstractmethod
    def advanced(self, here: Target) -> Target:
        """The point to fly to, one step after `path`. `here`: the vehicle's own place and velocity."""

    @abstractmethod
    def velocity(self, path: Target, r_F: Vec3) -> Vec3:
        """The velocity that leads to the path and along it, m/s."""

    def command(self, slot: Reference, r_n: Vec3, v_n: Vec3, q_nb: Quaternion, omega_b: Vec3) -> tuple[float, ...]:
        """Each rotor's speed as a share of its maximum, over the next step; called once per step. `slot`: the
        scenario's."""
        t, path = self._step * DT, Target(*slot)
        is_streamed = t - self._t_target <= self._timeout
        self.is_entered = self.is_entered or (t >= self._engage and (is_streamed or not self.needs_stream))
        self.is_following = self.is_entered and is_streamed
        yaw = slot.yaw if self._yaw is None else self._yaw
        if self.is_entered:
            path = self.path = self.advanced(Target(r_n, v_n, NO_MOTION, yaw))
        rate = self.yaw_gain * math.remainder(path.yaw - yaw, 2.0 * math.pi) + path.yaw_rate
        rate = min(max(rate, -self.max_yaw_rate), self.max_yaw_rate)
        self._step, self._yaw = self._step + 1, yaw + rate * DT
        ahead = rate / ATTITUDE_GAIN[2]  # makes up for the lag of the attitude controller
        return self._controller.steer(self._acceleration(path, r_n, v_n), self._yaw + ahead, q_nb, omega_b)

    def _acceleration(self, path: Target, r_F: Vec3, v_F: Vec3) -> Vec3:
        """The acceleration that leads to the path, as far as the lean may go, m/s^2."""
        error = difference(self.velocity(path, r_F), v_F)
        damped = by_axis(error if self.damps_error else v_F, self.derivative_gain)
        change = difference(
            scaled(difference(damped, self._before), self._step > 1 and 1.0 / DT), self._derivative
        )
        self._before, self._derivative = damped, add(self._derivative, scaled(change, DERIVATIVE_PASS))
        x, y, z = add(add(path.a_n, by_axis(error, self.velocity_gain)), add(self._integral, self._derivative))
        level = limited((x, y, 0.0), self.max_lean)
        if level == (x, y, 0.0):  # no wind-up while it is limited
            grown = add(self._integral, scaled(by_axis(error, self.integral_gain), DT))
            self._integral = limited(grown, MAX_INTEGRAL)
        return level[0], level[1], min(max(z, -MAX_VERTICAL_ACCELERATION), MAX_VERTICAL_ACCELERATION)


def scaled(v: Vec3, factor: float) -> Vec3:
    """A vector times a factor."""
    return v[0] * factor, v[1] * factor, v[2] * factor


def by_axis(v: Vec3, factors: Vec3) -> Vec3:
    """A vector times a factor for each axis."""
    return v[0] * factors[0], v[1] * factors[1], v[2] * factors[2]


def limited(v: Vec3, most: float) -> Vec3:
    """A vector no longer than `most`."""
    size = math.hypot(*v)
    return v if size <= most else scaled(v, most / size)
