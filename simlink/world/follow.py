"""The follower flown by an autopilot in FOLLOW mode, on FOLLOW_TARGETs alone.

The form is that of ArduCopter 4.7's FOLLOW mode with `FOLL_OFS_TYPE` 1 and `FOLL_ACCEL_H` 0 (`AP_Follow`,
`AC_PosControl`). The target's last position is carried on with its last velocity and acceleration, and the offset
turns with the target's heading. A path approaches that place within limits of speed, acceleration and jerk.
Position control flies the path by leaning the body, within a limit of lean. After `timeout` seconds without a
target, or beyond `dist_max`, the path brakes and stands still. Until `engage` the path is the scenario's slot.
"""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from onboard.messages import Quaternion, Vec3
from simlink.scenarios.formation import Follow
from simlink.scenarios.scenario import Scenario
from simlink.world.attitude import add, difference
from simlink.world.constants import DT, G
from simlink.world.quadrotor_control import Controller, Reference
from simlink.world.truth import State, states

POSITION_GAIN: Final = 1.0  # 1/s, PSC_NE_POS_P
VELOCITY_GAIN: Final = 2.0  # 1/s, PSC_NE_VEL_P
INTEGRAL_GAIN: Final = 1.0  # 1/s^2, PSC_NE_VEL_I
INTEGRAL_LIMIT: Final = 10.0  # m/s^2, PSC_NE_VEL_IMAX
NOWHERE: Final = (0.0, 0.0, 0.0)


class Target(NamedTuple):
    """A FOLLOW_TARGET: position from O, velocity and acceleration in n (m, m/s, m/s^2), heading (rad)."""

    r_n: Vec3
    v_n: Vec3
    heading: float
    a_n: Vec3 = NOWHERE


class FollowMode:
    """The mode, and the controllers below it: the pilot of a quadrotor. `is_following` is False while it brakes
    and holds. `begin_ns`: boot time at the start of the flight, from which all times here count. `custom_mode`:
    that of HEARTBEAT."""

    ground_mode, follow_mode = 4, 23  # GUIDED, FOLLOW

    def __init__(self, settings: Follow) -> None:
        self.begin_ns = 0
        self.is_following = False
        self.engage = settings.engage
        self._settings = settings
        self._controller = Controller(settings.craft, DT)
        self.most_lean = G * math.tan(math.radians(settings.lean_deg))
        self.yaw_step = math.radians(settings.yaw_rate_deg_s) * DT
        self._step = 0
        self._target: Target | None = None
        self._t_target = 0.0
        self._path: Reference | None = None
        self.integral: Vec3 = NOWHERE

    @property
    def is_before(self) -> bool:
        """Somebody else flies the vehicle still."""
        return self._step * DT <= self.engage

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT's number of the flight mode."""
        return self.ground_mode if self.is_before else self.follow_mode

    def accepts(self, *, is_own: bool, has_attitude: bool) -> bool:
        """Whether a FOLLOW_TARGET counts: as `AP_Follow`, only one of another system, and one that has an attitude
        for its offsets."""
        return has_attitude and not is_own

    def receive(self, target: Target, t: float) -> None:
        """A target that arrives at time `t`, s."""
        self._target, self._t_target = target, t

    def command(self, slot: Reference, r_n: Vec3, v_n: Vec3, q_nb: Quaternion, omega_b: Vec3) -> tuple[float, ...]:
        """Each rotor's speed as a share of its maximum, over the next step; called once per step. `slot`: the
        scenario's."""
        t, before = self._step * DT, self._path
        self._step += 1
        if before is None or t < self.engage:
            yaw = slot.yaw if before is None else slewed(before.yaw, slot.yaw, self.yaw_step)
            self._path = slot._replace(yaw=yaw)
        else:
            self._path = self.advanced(before, t, r_n)
        return self._controller.steer(self.acceleration(self._path, r_n, v_n), self._path.yaw, q_nb, omega_b)

    def advanced(self, path: Reference, t: float, r_F: Vec3) -> Reference:
        """The path one step later."""
        s, target = self._settings, self._target
        age = t - self._t_target
        self.is_following = False
        approach, v, a = NOWHERE, NOWHERE, NOWHERE
        if target is not None and age <= s.timeout:
            r_T = add(target.r_n, add(scaled(target.v_n, age), scaled(target.a_n, 0.5 * age * age)))
            if math.dist(r_T, r_F) <= s.dist_max:
                self.is_following = True
                error = difference(add(r_T, _turned(s.offset, target.heading)), path.r_n)
                approach = _by_axes(error, s.gain, s.acceleration, s.speed, s.climb)
                v, a = add(target.v_n, scaled(target.a_n, age)), target.a_n
        wanted = difference(add(approach, v), path.v_n)
        a = add(_by_axes(wanted, s.gain, s.jerk, s.acceleration, s.acceleration), a)
        a = add(path.a_n, limited(difference(a, path.a_n), s.jerk * DT))
        yaw = path.yaw if target is None else slewed(path.yaw, target.heading, self.yaw_step)
        r = add(add(path.r_n, scaled(path.v_n, DT)), scaled(a, 0.5 * DT * DT))
        return Reference(r, add(path.v_n, scaled(a, DT)), a, yaw)

    def acceleration(self, path: Reference, r_F: Vec3, v_F: Vec3) -> Vec3:
        """The acceleration that leads back to the path, as far as the lean may go, m/s^2."""
        error = difference(add(path.v_n, scaled(difference(path.r_n, r_F), POSITION_GAIN)), v_F)
        self.integral = limited(add(self.integral, scaled(error, INTEGRAL_GAIN * DT)), INTEGRAL_LIMIT)
        x, y, z = add(add(path.a_n, scaled(error, VELOCITY_GAIN)), self.integral)
        x, y, _ = limited((x, y, 0.0), self.most_lean)
        return x, y, min(max(z, -self._settings.acceleration * 2), self._settings.acceleration * 2)


def following_states(scenario: Scenario, seed: int, mode: FollowMode) -> Iterator[State]:
    """The world, 200 states per second without end: a quadrotor flies the scenario's slot until `engage`, then as
    the mode does. Targets may be given to the mode between states."""
    if scenario.follow is None:
        raise ValueError(f"{scenario.name} has no [follow]")
    return states(scenario, seed, mode)


def _by_axes(error: Vec3, gain: float, limit: float, level: float, upright: float) -> Vec3:
    """`_approach` in the horizontal plane and, apart from it, in height, with their greatest rates."""
    x, y, _ = _approach((error[0], error[1], 0.0), gain, limit, level)
    _, _, z = _approach((0.0, 0.0, error[2]), gain, limit, upright)
    return x, y, z


def _approach(error: Vec3, gain: float, limit: float, most: float) -> Vec3:
    """A rate that removes an error: `gain` times it, but never faster than a deceleration of `limit` can stop, nor
    than `most`. ArduPilot's square-root controller."""
    size = math.hypot(*error)
    if size == 0.0:
        return error
    linear = limit / (gain * gain)
    rate = gain * size if size <= linear else math.sqrt(2.0 * limit * (size - 0.5 * linear))
    return scaled(error, min(rate, most) / size)


def scaled(v: Vec3, factor: float) -> Vec3:
    """A vector times a factor."""
    return v[0] * factor, v[1] * factor, v[2] * factor


def limited(v: Vec3, most: float) -> Vec3:
    """A vector no longer than that."""
    size = math.hypot(*v)
    return v if size <= most else scaled(v, most / size)


def _turned(offset: Vec3, heading: float) -> Vec3:
    c, s = math.cos(heading), math.sin(heading)
    return c * offset[0] - s * offset[1], s * offset[0] + c * offset[1], offset[2]


def slewed(yaw: float, wanted: float, most: float) -> float:
    """A yaw that is at most so much nearer to the one that is wanted, rad."""
    change = math.remainder(wanted - yaw, 2 * math.pi)
    return yaw + max(-most, min(most, change))
