"""The follow law: a reference trajectory behind the leader that any multirotor can fly.

Horizontal, in polar coordinates about the smoothed leader. The slot turns about the leader behind its course, so
the vehicle goes round the leader and never through it. It closes up only as fast as it can stop before the nearest
place where the leader may be; uncertainty stops an approach and never causes a retreat. Speed, acceleration and
jerk are bounded. docs/follow.md derives the law.
"""

import math
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.leader import LeaderTrack, limited, sigma_along, wrapped
from onboard.config import GuidanceConfig

SEEN_S: Final = 0.3  # since the last usable state: the leader is seen
COAST_S: Final = 1.0  # further, in which a lost leader is followed as if it flew on: most drop-outs are shorter
LOOK_S: Final = 15.0  # further, in which the nose stays where the leader should be: a restart can take 8 s
TURN_GAIN: Final = 0.3  # 1/s, from the angle to the slot to the rate about the leader
APPROACH_GAIN, APPROACH_BRAKING = 0.5, 1.0  # 1/s, m/s^2: of the distance
BRAKING: Final = 2.2  # m/s^2, that every approach can count on: ArduPilot's default limit is 2.5
LEADER_BRAKING: Final = 1.6  # m/s^2, that the vehicle is ready for: more would make it fall behind at 12 m/s
REACTION_S: Final = 0.6  # until the vehicle brakes after its leader
BRAKING_IN_VIEW: Final = 2.0  # m/s^2; more pitches us up so far that the leader leaves the image
LEAD_TIME_S: Final = (
    0.6  # by which the vehicle's velocity lags: a leader that brakes is followed this much earlier
)
MAX_RETREAT_SPEED: Final = 4.0  # m/s, towards a slot that is farther off than we are
PASSING_DISTANCE_RATIO: Final = 0.7  # of the slot's distance, at which a leader that comes at us should pass
MAX_EVASION_SPEED_RATIO: Final = 0.8  # of the speed limit; the rest is left for backing off
MIN_COMING_SPEED: Final = 0.5  # m/s, beyond half a sigma: the leader comes at us
MIN_MISS_DISTANCE_M: Final = 3.0  # nearer, either side of the leader's path is as good
VELOCITY_GAIN: Final = 1.6  # 1/s, from the error of the reference's velocity to its acceleration
LEASH_M: Final = 6.0  # between reference and vehicle: what a vehicle lags behind at its greatest speed
CLIMB_GAIN, MAX_CLIMB_SPEED, MAX_CLIMB_ACCELERATION = 0.6, 1.5, 1.5  # 1/s, m/s, m/s^2
OWN_PLACE_M: Final = 2.0  # of a range's sigma that is no reason to stay where the leader may be nearer
SPEED_NOISE: Final = 0.4  # m/s, of a leader's speed that no caution is taken for
MIN_LOOK_DISTANCE: Final = 2.0  # m; nearer in the plane, the leader has no bearing
MIN_TURN_SPEED: Final = 2.0  # m/s, about a leader that is as fast as the vehicle


class Phase(StrEnum):
    """Phases of the follow law."""

    HOLD = "hold"  # no leader is known: stay
    FOLLOW = "follow"
    COAST = "coast"  # the leader is lost, and followed as if it flew on
    STOP = "stop"  # brake, with the nose where the leader should be, and give way to it


class Limits(NamedTuple):
    """Limits of the reference, horizontal: m/s, m/s^2, m/s^3, rad/s."""

    speed: float
    acceleration: float
    jerk: float = 6.0
    yaw_rate: float = 0.8


class ReferenceState(NamedTuple):
    """Position, velocity and acceleration (3,) of the reference in n, its heading (rad) and the rate of that."""

    r: Array
    v: Array
    a: Array
    yaw: float
    yaw_rate: float


class FollowLaw:
    """The law with its reference. `limits` may change in flight. `is_unsure`: the range is too uncertain to
    close up to the slot."""

    def __init__(self, config: GuidanceConfig) -> None:
        forward, right, self._down = config.slot_m
        self._config = config
        self.distance, self._side = math.hypot(forward, right), math.atan2(right, forward)
        given = config.min_distance_m
        self.min_distance = 0.85 * self.distance if given is None else min(given, self.distance)
        self.limits = Limits(config.max_speed_m_s, config.max_acceleration_m_s2)
        self.phase = Phase.HOLD
        self.is_unsure = False
        self._reference: ReferenceState | None = None

    @property
    def has_begun(self) -> bool:
        """There is a reference."""
        return self._reference is not None

    def begin(self, r_F: Array, v_F: Array, yaw: float) -> ReferenceState:
        """Put the reference where the vehicle is, with its velocity."""
        self.phase = Phase.HOLD
        self._reference = ReferenceState(r_F, v_F, np.zeros(3), yaw, 0.0)
        return self._reference

    def shift(self, step: Array) -> None:
        """Move the origin of n (3,): the autopilot's position was reset by `step`."""
        if self._reference is not None:
            self._reference = self._reference._replace(r=self._reference.r + step)

    def step(
        self, leader: LeaderTrack, lost_s: float, turn: float, r_F: Array | None, dt: float, lift: float = 0.0
    ) -> ReferenceState:
        """The reference `dt` s later. `lost_s`: since the leader was seen. `turn`: rate of the slot's course,
        rad/s. `r_F` (3,): our own position; without it the reference brakes and stays. `lift`: is added to the
        slot's height (m, down)."""
        before = self._reference
        assert before is not None  # noqa: S101 - `begin` comes first
        r_F = before.r if (is_blind := r_F is None) else r_F
        self.phase = _phase(lost_s) if leader.is_known and not is_blind else Phase.HOLD
        self.is_unsure = False
        if self.phase is Phase.HOLD:
            made = self._moved(before, np.zeros(3), np.zeros(3), dt)
        elif self.phase is Phase.STOP:
            made = self._moved(before, self._give_way(before, leader), np.zeros(3), dt)
        else:
            made = self._follow(before, leader, turn, r_F, dt, lift)
        r = r_F + limited(made.r - r_F, LEASH_M)
        self._reference = made = self._looking(made._replace(r=r), leader, r_F)
        return made

    def max_turn_rate(self, leader: LeaderTrack) -> float:
        """The rate at which the slot can be turned about the leader, rad/s."""
        return max_turn_rate(math.hypot(*leader.v[:2]), self.distance, self.limits)

    def _follow(
        self, before: ReferenceState, leader: LeaderTrack, turn: float, r_F: Array, dt: float, lift: float
    ) -> ReferenceState:
        d, max_rate = self.distance, self.max_turn_rate(leader)
        out = before.r[:2] - leader.r[:2]
        rho = max(float(np.linalg.norm(out)), 0.1)
        u = out / rho
        here = min(rho, max(float(np.linalg.norm(r_F[:2] - leader.r[:2])), 0.1))
        sigma = sigma_along(leader.range_covariance[:2, :2], u)
        near = here * math.exp(-2.0 * sigma / max(here, 1.0))
        self.is_unsure = near < self.min_distance <= here

        angle = wrapped(leader.slot_course + self._side - math.atan2(u[1], u[0]))
        rate = min(max(TURN_GAIN * angle + turn, -max_rate), max_rate)
        closing = self._config.max_closing_speed_m_s
        off = d - rho if rho > d else max(d - rho - max(sigma - OWN_PLACE_M, 0.0), 0.0)
        radial = min(max(_stopping(off, APPROACH_GAIN, APPROACH_BRAKING), -closing), MAX_RETREAT_SPEED)
        speed, sure_speed = float(leader.v[:2] @ u), self._sure_speed(leader, u, near)
        radial = max(radial, -_closing_limit(max(near - self.min_distance, 0.0), max(-sure_speed, 0.0)))
        across = min(rho, d) * rate  # from afar straight to the slot

        leader_v = leader.v[:2] + (sure_speed - speed) * u
        level = self._evade(leader_v + radial * u + across * np.array([-u[1], u[0]]), before, leader)
        v = np.array([*level, self._climb(before, leader, lift)])
        a_L = leader.a[:2] if near > self.min_distance - 5.0 else np.zeros(2)
        a_L = a_L - max(float(a_L @ u), 0.0) * (1.0 - min(max(sure_speed, 0.0) / max(speed, 0.1), 1.0)) * u
        a = np.array([*(a_L - min(rho, d) * rate * rate * u), 0.0])
        return self._moved(before, v, a, dt, (u, self._braking(before, leader, u, here)))

    def _evade(self, v: Array, before: ReferenceState, leader: LeaderTrack) -> Array:
        """Limit velocity v (2,) to the greatest speed, and leave the path of a leader that comes at us."""
        limit, speed = self.limits.speed, max(float(np.linalg.norm(leader.v[:2])), 0.1)
        out = before.r[:2] - leader.r[:2]
        path = leader.v[:2] / speed
        way = float(out @ path)  # m, of the leader until it passes us
        aside = out - way * path
        miss, passing = float(np.linalg.norm(aside)), PASSING_DISTANCE_RATIO * self.distance
        coming = speed * way / max(float(np.linalg.norm(out)), 0.1)
        if coming < MIN_COMING_SPEED + 0.5 * sigma_along(leader.covariance[3:5, 3:5], path):
            return limited(v, limit)
        side = np.array([-path[1], path[0]])
        begun = before.v[:2] if abs(float(before.v[:2] @ side)) > MIN_COMING_SPEED else v
        side = side * math.copysign(1.0, float((aside if miss > MIN_MISS_DISTANCE_M else begun) @ side))
        needed = min((passing - miss) * speed / way, MAX_EVASION_SPEED_RATIO * limit)
        across = max(min(max(float(v @ side), needed), limit), -limit)
        along = limited(float(v @ path) * path, math.sqrt(limit * limit - across * across))
        return along + across * side

    def _sure_speed(self, leader: LeaderTrack, u: Array, near: float) -> float:
        """The leader's speed to us along u (2,), as far as it is sure: the vehicle retreats from a sure speed
        only, and follows a leader that flies off as fast as is sure where that one may be near."""
        smooth, seen = float(leader.v[:2] @ u), float(leader.v_seen[:2] @ u)
        speed = min(smooth, seen + SPEED_NOISE) if smooth > 0.0 else max(smooth, min(seen - SPEED_NOISE, 0.0))
        speed += LEAD_TIME_S * min(float(leader.a[:2] @ u), 0.0)
        sigma = sigma_along(leader.covariance[3:5, 3:5], u)
        if speed > 0.0:
            return max(speed - max(1.5 * sigma - 1.0, 0.0), 0.0)
        doubt = min(max((self.distance - near) / (0.25 * self.distance), 0.0), 1.0)
        return min(speed + max((1.0 + doubt) * sigma - SPEED_NOISE, 0.0), 0.0)

    def _braking(self, before: ReferenceState, leader: LeaderTrack, u: Array, here: float) -> float:
        """The greatest acceleration away from the leader, m/s^2: more than keeps it in the image only where the
        stop needs it."""
        closing = float((leader.v - before.v)[:2] @ u)
        need = closing * closing / (2.0 * max(here - self.min_distance, 1.0)) if closing > 0.0 else 0.0
        room = (here - self.min_distance) / max(self.distance - self.min_distance, 1.0)
        hard = self.limits.acceleration - min(max(room, 0.0), 1.0) * (self.limits.acceleration - BRAKING_IN_VIEW)
        return min(max(hard, need + float(leader.a[:2] @ u)), self.limits.acceleration)

    def _climb(self, before: ReferenceState, leader: LeaderTrack, lift: float) -> float:
        """The vertical velocity that leads to the slot's height, but not below `min_height_m`."""
        height = min(float(leader.r[2]) + self._down + lift, -self._config.min_height_m)
        sure = max(abs(float(leader.v[2])) - math.sqrt(max(leader.covariance[5, 5], 0.0)), 0.0)
        v = CLIMB_GAIN * (height - before.r[2]) + math.copysign(sure, leader.v[2])
        return float(min(max(v, -MAX_CLIMB_SPEED), MAX_CLIMB_SPEED))

    def _give_way(self, before: ReferenceState, leader: LeaderTrack) -> Array:
        """The velocity (3,) away from a lost leader that should be nearer than the slot's distance."""
        out = before.r[:2] - leader.r[:2]
        rho = max(float(np.linalg.norm(out)), 0.1)
        off = self.distance - rho - sigma_along(leader.range_covariance[:2, :2], out / rho)
        if off <= 0.0:
            return np.zeros(3)
        coming = float(leader.v[:2] @ out) / rho - sigma_along(leader.covariance[3:5, 3:5], out / rho)
        speed = _stopping(off, APPROACH_GAIN, APPROACH_BRAKING) + max(coming, 0.0)
        return np.array([*(min(speed, self.limits.speed) / rho * out), 0.0])

    def _moved(
        self, before: ReferenceState, v: Array, a: Array, dt: float, away: tuple[Array, float] | None = None
    ) -> ReferenceState:
        """The reference after `dt` s towards velocity v with acceleration a fed forward. `away`: a direction
        (2,) and the greatest acceleration along it."""
        limits = self.limits
        wanted = a + VELOCITY_GAIN * (v - before.v)
        level = limited(wanted[:2], limits.acceleration if away else min(BRAKING, limits.acceleration))
        if away is not None:
            u, braking = away
            level = level - max(float(level @ u) - braking, 0.0) * u
        climb = min(max(float(wanted[2]), -MAX_CLIMB_ACCELERATION), MAX_CLIMB_ACCELERATION)
        a = before.a + limited(np.array([*level, climb]) - before.a, limits.jerk * dt)
        v = before.v + dt * a
        v[:2] = limited(v[:2], limits.speed)
        return before._replace(r=before.r + dt * v, v=v, a=a)

    def _looking(self, made: ReferenceState, leader: LeaderTrack, r_F: Array) -> ReferenceState:
        """With the nose on the leader, and its rate."""
        x, y = (leader.r - r_F)[:2].tolist()
        if self.phase is Phase.HOLD or math.hypot(x, y) < MIN_LOOK_DISTANCE:
            return made._replace(yaw_rate=0.0)
        vx, vy = (leader.v - made.v)[:2].tolist()
        rate, limit = (x * vy - y * vx) / (x * x + y * y), self.limits.yaw_rate
        return made._replace(yaw=math.atan2(y, x), yaw_rate=min(max(rate, -limit), limit))


def max_turn_rate(speed: float, arm: float, limits: Limits) -> float:
    """The rate (rad/s) at which a slot on an `arm` (m) about a leader at `speed` (m/s) can be turned: the slot
    flies at w arm beside the leader's speed v, with an acceleration of w sqrt(v^2 + (w arm)^2)."""
    square, lean = speed * speed, 2.0 * arm * limits.acceleration
    by_acceleration = math.sqrt(0.5 * (math.sqrt(square * square + lean * lean) - square)) / arm
    spare = math.sqrt(max(limits.speed**2 - square, MIN_TURN_SPEED**2))
    return min(by_acceleration, spare / arm)


def _phase(lost_s: float) -> Phase:
    if lost_s <= SEEN_S:
        return Phase.FOLLOW
    if lost_s <= SEEN_S + COAST_S:
        return Phase.COAST
    return Phase.STOP if lost_s <= SEEN_S + COAST_S + LOOK_S else Phase.HOLD


def _stopping(way: float, gain: float, braking: float) -> float:
    """The speed with which to come to rest after a way: linear near the end, and with constant braking far from
    it."""
    linear = braking / (gain * gain)
    if abs(way) <= linear:
        return gain * way
    return math.copysign(math.sqrt(2.0 * braking * (abs(way) - 0.5 * linear)), way)


def _closing_limit(gap: float, speed: float) -> float:
    """The closing speed at which the vehicle can stop within the `gap` (m) behind a leader that flies off with
    `speed` (m/s) and brakes."""
    lag = REACTION_S * BRAKING
    total = math.sqrt(lag * lag + 2.0 * BRAKING * (gap + speed * speed / (2.0 * LEADER_BRAKING))) - lag
    return max(total - speed, 0.0)
