"""The follower flown by PX4's Follow-Me, on FOLLOW_TARGETs alone.

The form is that of PX4 1.17 (`FlightTaskAutoFollowTarget`, `TargetEstimator`, `PositionControl`) with
`FLW_TGT_ALT_M` 0. An alpha-beta-gamma filter takes the target's position at most every 0.5 s and its velocity
every 0.1 s; a second-order filter smooths it. The vehicle flies on a circle of `FLW_TGT_DST` about the smoothed
target. Its angle there moves towards the target's course plus `FLW_TGT_FA` within limits of speed, acceleration
and jerk, and begins **north of the target**, wherever the vehicle is. The course is that of the smoothed velocity
above 1 m/s; it is north at first. Heading, acceleration and sender of the message do not count. 3 s after the last
target the filter stands still, and the vehicle flies on to its place about it. The height is the one at `engage`.
"""

import math
from typing import Final

from onboard.messages import Vec3
from simlink.scenarios.formation import Follow
from simlink.world.attitude import add, difference
from simlink.world.constants import DT
from simlink.world.follow import NOWHERE, FollowMode, Target, limited, scaled, slewed
from simlink.world.quadrotor_control import Reference

RESPONSIVENESS: Final = 0.5  # FLW_TGT_RS
ORBIT_SPEED, ORBIT_ACCELERATION, ORBIT_JERK = 8.0, 2.0, 4.0  # m/s (FLW_TGT_MAX_VEL), m/s^2, m/s^3
POSITION_FUSION, VELOCITY_FUSION, STALE = 0.5, 0.1, 3.0  # s
MOST_ACCELERATION: Final = 20.0  # m/s^2, of the target
SMOOTHING, DAMPING = 1.0, 0.7071  # rad/s
MOVES: Final = 1.0  # m/s
HEIGHT_ACCEPTED: Final = 3.0  # m; beyond, only the height is flown
POSITION_GAIN, HEIGHT_GAIN, VELOCITY_GAIN, INTEGRAL_GAIN = (
    0.95,
    1.0,
    1.8,
    0.4,
)  # MPC_XY_P, MPC_Z_P, MPC_XY_VEL_*_ACC
SPEED, CLIMB, SINK = 12.0, 3.0, 1.5  # m/s, MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_*

BETA: Final = RESPONSIVENESS ** (1.0 / 3.0)
BETA_V: Final = 0.9 * BETA
GAIN_R, GAIN_V, GAIN_A = 1.0 - BETA**3, 1.5 * (1.0 - BETA) ** 2 * (1.0 + BETA), (1.0 - BETA) ** 3
GAIN_VV, GAIN_VA = 1.0 - BETA_V**2, (1.0 - BETA_V) ** 2


class TargetFilter:
    """The target as PX4 estimates it: position, velocity, acceleration (n); None before the first."""

    def __init__(self) -> None:
        self.r: Vec3 | None = None
        self.v: Vec3 = NOWHERE
        self._a: Vec3 = NOWHERE
        self._t = self._t_r = self._t_v = -math.inf  # of the last message, and what was taken of it

    def receive(self, target: Target, t: float) -> None:
        """A message at time `t`, s."""
        if self.r is None:
            self.r, self.v = target.r_n, target.v_n
        self._t = t
        if t - self._t_r > POSITION_FUSION:
            dt, off = min(t - self._t_r, 20.0), difference(target.r_n, self.r)
            self.r = add(self.r, scaled(off, GAIN_R))
            self.v = add(self.v, scaled(off, GAIN_V / dt))
            self._a = add(self._a, scaled(off, GAIN_A / dt**2))
            self._t_r = t
        if t - self._t_v > VELOCITY_FUSION:
            dt, off = min(t - self._t_v, 20.0), difference(target.v_n, self.v)
            self.v = add(self.v, scaled(off, GAIN_VV))
            self._a = add(self._a, scaled(off, GAIN_VA / dt))
            self._t_v = t
        self._a = limited(self._a, MOST_ACCELERATION)

    def step(self, t: float) -> None:
        """One step of the world later."""
        if self.r is None:
            return
        self.r = add(self.r, add(scaled(self.v, DT), scaled(self._a, 0.5 * DT * DT)))
        self.v = add(self.v, scaled(self._a, DT))
        if t - self._t >= STALE:
            self.v = self._a = NOWHERE


class Px4FollowMode(FollowMode):
    """Follow-Me, and PX4's position control below it."""

    ground_mode, follow_mode = 6 << 16, 8 << 24 | 4 << 16  # OFFBOARD, AUTO_FOLLOW_TARGET

    def __init__(self, settings: Follow) -> None:
        super().__init__(settings)
        x, y, _ = settings.offset
        self._distance, self._angle = math.hypot(x, y), math.atan2(y, x)  # FLW_TGT_DST, FLW_TGT_FA
        self._filter = TargetFilter()
        self._kept: Target | None = None  # which it begins on, however old
        self._r: Vec3 | None = None  # of the smoothed target
        self._v: Vec3 = NOWHERE
        self._course = 0.0
        self._orbit = self._orbit_rate = self._orbit_acceleration = 0.0
        self._height: float | None = None
        self._stays: Vec3 | None = None

    def accepts(self, *, is_own: bool, has_attitude: bool) -> bool:  # noqa: ARG002 - it looks at neither
        """Every message."""
        return True

    def receive(self, target: Target, t: float) -> None:
        """A target that arrives at time `t`, s. Before the mode is entered nobody takes it; the last is kept."""
        if t >= self.engage:
            self._filter.receive(target, t)
        else:
            self._kept = target

    def advanced(self, path: Reference, t: float, r_F: Vec3) -> Reference:
        """The set point one step later."""
        if self._kept is not None:
            self._filter.receive(self._kept, t)
            self._kept = None
        self._filter.step(t)
        self._height = r_F[2] if self._height is None else self._height
        r_T, self.is_following = self._filter.r, self._filter.r is not None
        if r_T is None:
            self._stays = r_F if self._stays is None else self._stays
            return Reference(self._stays, NOWHERE, NOWHERE, path.yaw)
        self._smooth(r_T, self._filter.v)
        if min(math.hypot(*self._v[:2]), math.hypot(*self._filter.v[:2])) >= MOVES:
            self._course = math.atan2(self._v[1], self._v[0])
        self._turn()
        assert self._r is not None  # noqa: S101 - it is smoothed
        d, w, c, s = self._distance, self._orbit_rate, math.cos(self._orbit), math.sin(self._orbit)
        yaw = slewed(path.yaw, math.atan2(self._r[1] - r_F[1], self._r[0] - r_F[0]), self.yaw_step)
        if abs(self._height - r_F[2]) >= HEIGHT_ACCEPTED:
            return Reference((r_F[0], r_F[1], self._height), NOWHERE, NOWHERE, yaw)
        r = (self._r[0] + d * c, self._r[1] + d * s, self._height)
        v = (self._v[0] - d * w * s, self._v[1] + d * w * c, 0.0)
        at = d * self._orbit_acceleration
        return Reference(r, v, (-d * w * w * c - at * s, -d * w * w * s + at * c, 0.0), yaw)

    def acceleration(self, path: Reference, r_F: Vec3, v_F: Vec3) -> Vec3:
        """PX4's position and velocity control, m/s^2."""
        if self.is_before:
            return super().acceleration(path, r_F, v_F)
        off = difference(path.r_n, r_F)
        back = limited((POSITION_GAIN * off[0], POSITION_GAIN * off[1], 0.0), SPEED)
        level = _within(back, (path.v_n[0], path.v_n[1], 0.0), SPEED)
        climb = min(max(HEIGHT_GAIN * off[2] + path.v_n[2], -CLIMB), SINK)
        error = difference((level[0], level[1], climb), v_F)
        self.integral = limited(add(self.integral, scaled(error, INTEGRAL_GAIN * DT)), 10.0)
        x, y, z = add(add(path.a_n, scaled(error, VELOCITY_GAIN)), self.integral)
        x, y, _ = limited((x, y, 0.0), self.most_lean)
        return x, y, min(max(z, -5.0), 5.0)

    def _smooth(self, r: Vec3, v: Vec3) -> None:
        if self._r is None:
            self._r, self._v = r, v
        spring = scaled(difference(r, self._r), SMOOTHING**2)
        a = add(spring, scaled(difference(v, self._v), 2.0 * DAMPING * SMOOTHING))
        self._v = add(self._v, scaled(a, DT))
        self._r = add(self._r, scaled(self._v, DT))

    def _turn(self) -> None:
        """The angle about the target, towards the course plus `FLW_TGT_FA`."""
        jerk, limit, most = (x / self._distance for x in (ORBIT_JERK, ORBIT_ACCELERATION, ORBIT_SPEED))
        left = math.remainder(self._course + self._angle - self._orbit, 2.0 * math.pi)
        b = 4.0 * limit * limit / jerk
        wanted = min(0.5 * (math.sqrt(b * b + 8.0 * limit * abs(left)) - b), most)
        change = math.copysign(wanted, left) - self._orbit_rate
        goal = math.copysign(min(limit, math.sqrt(2.0 * jerk * abs(change))), change)
        self._orbit_acceleration += min(max(goal - self._orbit_acceleration, -jerk * DT), jerk * DT)
        self._orbit_rate += self._orbit_acceleration * DT
        self._orbit += self._orbit_rate * DT


def _within(first: Vec3, second: Vec3, most: float) -> Vec3:
    """The sum of both, or as much of the second as the length allows."""
    whole = add(first, second)
    if math.hypot(*whole) <= most:
        return whole
    share = 1.0
    for _ in range(20):
        share *= 0.8
        if math.hypot(*add(first, scaled(second, share))) <= most:
            break
    return limited(add(first, scaled(second, share)), most)
