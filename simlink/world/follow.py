"""The follower flown by an autopilot in FOLLOW mode, on FOLLOW_TARGETs alone.

The form is that of ArduCopter 4.7's FOLLOW mode with `FOLL_OFS_TYPE` 1 and `FOLL_ACCEL_H` 0 (`AP_Follow`). The
target's last position is carried on with its last velocity, the offset turns with the target's heading, and
position control limits acceleration and jerk. After `timeout` seconds without a target, or beyond `dist_max`, the
vehicle brakes and holds its position.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

from onboard.messages import Vec3
from simlink.scenarios.formation import Follow
from simlink.scenarios.scenario import Scenario
from simlink.world.attitude import add, difference
from simlink.world.constants import DT, STEPS_PER_SECOND
from simlink.world.motion import advance, make_motion
from simlink.world.noise import uniforms
from simlink.world.truth import State, hovering, leader_attitudes, state_of


class Target(NamedTuple):
    """A FOLLOW_TARGET: position from O and velocity in n (m, m/s), heading (rad)."""

    r_n: Vec3
    v_n: Vec3
    heading: float


class FollowMode:
    """The mode's state. `is_following` is False while it brakes and holds. `begin_ns`: boot time at the start of
    the flight, from which all times here count."""

    def __init__(self, settings: Follow) -> None:
        self.begin_ns = 0
        self.is_following = False
        self.engage = settings.engage
        self._settings = settings
        self._target: Target | None = None
        self._t_target = 0.0
        self._a: Vec3 = (0.0, 0.0, 0.0)
        self.yaw_step = math.radians(settings.yaw_rate_deg_s) * DT

    def hand_over(self, a_F: Vec3) -> None:
        """Another pilot flies with this acceleration: the mode begins with it."""
        self._a = a_F

    def receive(self, target: Target, t: float) -> None:
        """A target that arrives at time `t`, s."""
        self._target, self._t_target = target, t

    def acceleration(self, t: float, r_F: Vec3, v_F: Vec3) -> Vec3:
        """The acceleration over the next step of DT, m/s^2."""
        s, target = self._settings, self._target
        age = t - self._t_target
        self.is_following = False
        wanted = (0.0, 0.0, 0.0)
        if target is not None and age <= s.timeout:
            r_T = add(target.r_n, _scaled(target.v_n, age))
            if math.dist(r_T, r_F) <= s.dist_max:
                self.is_following = True
                error = difference(add(r_T, _turned(s.offset, target.heading)), r_F)
                wanted = add(_approach(error, s.gain, s.acceleration, s.speed), target.v_n)
        a = _approach(difference(wanted, v_F), s.gain, s.jerk, s.acceleration)
        self._a = add(self._a, _limited(difference(a, self._a), s.jerk * DT))
        return self._a

    @property
    def heading(self) -> float | None:
        """That of the last target, rad; None before there is one."""
        return None if self._target is None else self._target.heading


def following_states(scenario: Scenario, seed: int, mode: FollowMode) -> Iterator[State]:
    """The world, 200 states per second without end: until `engage` the follower keeps the scenario's slot, then
    the mode flies it. Targets may be given to the mode between states."""
    phase, turn = uniforms(seed, "follower.wander"), 2 * math.pi
    f, y = make_motion(scenario, (turn * next(phase), turn * next(phase), turn * next(phase)))
    leader_attitude = leader_attitudes(scenario, seed)
    step, q_before, yaw = 0, None, y[0]
    wanted_yaw: float | None
    r_F, v_F = (y[5], y[6], y[7]), (y[8], y[9], y[10])
    while True:
        t = step / STEPS_PER_SECOND
        rates = f(t, y)
        if t < mode.engage:
            r_F, v_F, a_F, wanted_yaw = (y[5], y[6], y[7]), (y[8], y[9], y[10]), rates.a_F_n, y[0]
            mode.hand_over(a_F)
        else:
            a_F, wanted_yaw = mode.acceleration(t, r_F, v_F), mode.heading
        yaw = _slewed(yaw, yaw if wanted_yaw is None else wanted_yaw, mode.yaw_step)
        q_nF = hovering(a_F, yaw)
        q_nL = leader_attitude(t, y, rates)
        yield state_of(step, (y[2], y[3], y[4]), rates, q_nL, (r_F, v_F, a_F), q_nF, q_before)
        r_F = add(add(r_F, _scaled(v_F, DT)), _scaled(a_F, 0.5 * DT * DT))
        v_F = add(v_F, _scaled(a_F, DT))
        y = advance(f, t, y, rates, DT)
        step, q_before = step + 1, q_nF


def _approach(error: Vec3, gain: float, limit: float, most: float) -> Vec3:
    """A rate that removes an error: `gain` times it, but never faster than a deceleration of `limit` can stop, nor
    than `most`. ArduPilot's square-root controller."""
    size = math.hypot(*error)
    if size == 0.0:
        return error
    linear = limit / (gain * gain)
    rate = gain * size if size <= linear else math.sqrt(2.0 * limit * (size - 0.5 * linear))
    return _scaled(error, min(rate, most) / size)


def _scaled(v: Vec3, factor: float) -> Vec3:
    return v[0] * factor, v[1] * factor, v[2] * factor


def _limited(v: Vec3, most: float) -> Vec3:
    size = math.hypot(*v)
    return v if size <= most else _scaled(v, most / size)


def _turned(offset: Vec3, heading: float) -> Vec3:
    c, s = math.cos(heading), math.sin(heading)
    return c * offset[0] - s * offset[1], s * offset[0] + c * offset[1], offset[2]


def _slewed(yaw: float, wanted: float, most: float) -> float:
    change = math.remainder(wanted - yaw, 2 * math.pi)
    return yaw + max(-most, min(most, change))
