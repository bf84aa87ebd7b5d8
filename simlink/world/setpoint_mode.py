"""The follower flown by an autopilot on SET_POSITION_TARGET_LOCAL_NED.

`GuidedMode` (ArduCopter) and `OffboardMode` (PX4) each turn setpoints into a path. The position and velocity
control of this module flies the path by tilting the body. Before the mode is entered the autopilot is in its
loiter mode, and the follower flies the scenario's slot. From `engage` on the pilot requests the mode until the
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
DERIVATIVE_FILTER_GAIN: Final = 1.0 - math.exp(-2.0 * math.pi * 5.0 * DT)  # 5 Hz: PSC_VELXY_FLTD, MPC_VELD_LP
MAX_INTEGRAL_ACCELERATION: Final = 10.0  # m/s^2, PSC_VELXY_IMAX
MAX_VERTICAL_ACCELERATION: Final = 5.0  # m/s^2; the craft's motors have twice that


class Target(NamedTuple):
    """A setpoint or a point of a path, in n."""

    r_n: Vec3  # m
    v_n: Vec3  # m/s
    a_n: Vec3  # m/s^2
    yaw: float  # rad
    yaw_rate: float = 0.0  # rad/s

    def extrapolated(self) -> "Target":
        """Return the target extrapolated by one step of the world."""
        r, v = (
            add(self.r_n, scale(add(self.v_n, scale(self.a_n, 0.5 * DT)), DT)),
            add(self.v_n, scale(self.a_n, DT)),
        )
        return Target(r, v, self.a_n, self.yaw + self.yaw_rate * DT, self.yaw_rate)


class SetpointMode(ABC):
    """A flight mode on setpoints, as the pilot of a quadrotor.

    `begin_ns` is the boot time at the start of the flight, from which times count here. `is_following` tells
    whether a setpoint is obeyed.
    """

    loiter_mode: int  # custom_mode of HEARTBEAT
    setpoint_mode: int  # custom_mode of HEARTBEAT
    needs_stream: bool  # whether entering and keeping the mode needs a stream of setpoints
    velocity_gain: Vec3  # 1/s
    integral_gain: Vec3  # 1/s^2
    derivative_gain: Vec3
    damps_error: bool  # whether the derivative term uses the velocity error instead of the velocity
    max_lean: float  # m/s^2, the horizontal acceleration at the largest tilt
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
        """The mode that the pilot wants, as a `custom_mode`."""
        return self.setpoint_mode if self.is_entered else self.loiter_mode

    @property
    def custom_mode(self) -> int:
        """The number of the flight mode in HEARTBEAT."""
        return self.loiter_mode if self.needs_stream and not self.is_following else self.intended_mode

    def receive(self, target: Target, t: float) -> None:
        """Accept a setpoint that arrives at time `t`, s."""
        if self.is_entered or self.needs_stream:
            self.target, self._t_target = target, t

    @abstractmethod
    def next_target(self, here: Target) -> Target:
        """Return the point to fly to, one step after `path`.

        `here` is the vehicle's own position and velocity.
        """

    @abstractmethod
    def velocity(self, path: Target, r_F: Vec3) -> Vec3:
        """Return the velocity that leads to the path and along it, m/s."""

    def command(self, slot: Reference, r_n: Vec3, v_n: Vec3, q_nb: Quaternion, omega_b: Vec3) -> tuple[float, ...]:
        """Return each rotor's speed as a share of its maximum, over the next step.

        It is called once per step; `slot` is the scenario's.
        """
        t, path = self._step * DT, Target(*slot)
        is_streamed = t - self._t_target <= self._timeout
        self.is_entered = self.is_entered or (t >= self._engage and (is_streamed or not self.needs_stream))
        self.is_following = self.is_entered and is_streamed
        yaw = slot.yaw if self._yaw is None else self._yaw
        if self.is_entered:
            path = self.path = self.next_target(Target(r_n, v_n, NO_MOTION, yaw))
        rate = self.yaw_gain * math.remainder(path.yaw - yaw, 2.0 * math.pi) + path.yaw_rate
        rate = min(max(rate, -self.max_yaw_rate), self.max_yaw_rate)
        self._step, self._yaw = self._step + 1, yaw + rate * DT
        ahead = rate / ATTITUDE_GAIN[2]  # makes up for the lag of the attitude controller
        return self._controller.steer(self._acceleration(path, r_n, v_n), self._yaw + ahead, q_nb, omega_b)

    def _acceleration(self, path: Target, r_F: Vec3, v_F: Vec3) -> Vec3:
        """Return the acceleration that leads to the path, within the limit of the tilt, m/s^2."""
        error = difference(self.velocity(path, r_F), v_F)
        damped = scale_axes(error if self.damps_error else v_F, self.derivative_gain)
        change = difference(scale(difference(damped, self._before), self._step > 1 and 1.0 / DT), self._derivative)
        self._before, self._derivative = damped, add(self._derivative, scale(change, DERIVATIVE_FILTER_GAIN))
        x, y, z = add(add(path.a_n, scale_axes(error, self.velocity_gain)), add(self._integral, self._derivative))
        level = limit_length((x, y, 0.0), self.max_lean)
        if level == (x, y, 0.0):  # no wind-up while it is limited
            grown = add(self._integral, scale(scale_axes(error, self.integral_gain), DT))
            self._integral = limit_length(grown, MAX_INTEGRAL_ACCELERATION)
        return level[0], level[1], min(max(z, -MAX_VERTICAL_ACCELERATION), MAX_VERTICAL_ACCELERATION)


def scale(v: Vec3, factor: float) -> Vec3:
    """Return a vector times a factor."""
    return v[0] * factor, v[1] * factor, v[2] * factor


def scale_axes(v: Vec3, factors: Vec3) -> Vec3:
    """Return a vector times a factor for each axis."""
    return v[0] * factors[0], v[1] * factors[1], v[2] * factors[2]


def limit_length(v: Vec3, most: float) -> Vec3:
    """Return a vector, shortened to the length `most` if it is longer."""
    size = math.hypot(*v)
    return v if size <= most else scale(v, most / size)
