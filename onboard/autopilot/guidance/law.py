"""The follow law: a reference trajectory behind the leader that any multirotor can fly.

Horizontal, in polar coordinates about the smoothed leader. The slot turns about the leader with its course, so the
vehicle goes round the leader and never through it. It closes in only as fast as it can stop before the nearest
place where the leader may be; uncertainty stops an approach and never causes a retreat. Speed, acceleration and
jerk are bounded. docs/follow.md derives the law.
"""

import math
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.leader import LeaderTrack, limit_length, sigma_along, wrap_angle
from onboard.config import GuidanceConfig

FOLLOW_TIMEOUT_S: Final = 1.3  # since the last usable state; most drop-outs are shorter
LOOK_DURATION_S: Final = 15.0  # a restart of the daemon or the camera can take 8 s
TURN_GAIN: Final = 0.3  # 1/s, from the angle to the slot to the rate about the leader
APPROACH_GAIN: Final = 0.5  # 1/s, from distance to speed near the slot
APPROACH_ACCELERATION_M_S2: Final = 1.0  # constant braking far from the slot
FOLLOWER_ACCELERATION_M_S2: Final = 2.2  # braking that every approach relies on; ArduPilot's default limit is 2.5
LEADER_ACCELERATION_M_S2: Final = 1.6  # braking of the leader that is allowed for; with more we lag at 12 m/s
REACTION_TIME_S: Final = 0.6  # until the vehicle brakes after its leader
MAX_ACCELERATION_IN_VIEW_M_S2: Final = 2.0  # braking harder pitches the leader out of the image
LEAD_TIME_S: Final = 0.6  # a leader that brakes is followed earlier by this lag of the vehicle's velocity
MAX_RETREAT_SPEED_M_S: Final = 4.0
PASSING_DISTANCE_RATIO: Final = 0.7  # of the slot's distance, at which an oncoming leader should pass
MAX_EVASION_SPEED_RATIO: Final = 0.8  # of the speed limit; the rest is left for backing off
MIN_ONCOMING_SPEED_M_S: Final = 0.5  # beyond half a sigma
MIN_MISS_DISTANCE_M: Final = 3.0  # nearer, either side of the leader's path is as good
VELOCITY_GAIN: Final = 1.6  # 1/s, from the error of the reference's velocity to its acceleration
MAX_REFERENCE_DISTANCE_M: Final = 6.0  # from the vehicle: its lag at its greatest speed
CLIMB_GAIN: Final = 0.6  # 1/s
MAX_CLIMB_SPEED_M_S: Final = 1.5
MAX_CLIMB_ACCELERATION_M_S2: Final = 1.5
RANGE_SIGMA_TOLERANCE_M: Final = 2.0  # the vehicle backs off into its slot in spite of this uncertainty
SPEED_NOISE_M_S: Final = 0.4  # of the leader's speed
MIN_BEARING_DISTANCE: Final = 2.0  # m; nearer in the plane, the leader has no bearing
MIN_TURN_SPEED_M_S: Final = 2.0  # about a leader that is as fast as the vehicle


class Phase(StrEnum):
    """Phases of the follow law."""

    HOLD = "hold"  # no leader is known: stay
    FOLLOW = "follow"  # the leader is seen, or was seen until a moment ago
    STOP = "stop"  # the leader is lost: brake, point the nose to where it should be, and give way to it


class Limits(NamedTuple):
    """Horizontal limits of the reference: m/s, m/s^2, m/s^3, rad/s."""

    speed: float
    acceleration: float
    jerk: float = 6.0
    yaw_rate: float = 0.8


class ReferenceState(NamedTuple):
    """Motion of the reference in n: vectors (3,), heading (rad) and yaw rate (rad/s)."""

    r: Array
    v: Array
    a: Array
    yaw: float
    yaw_rate: float


class FollowLaw:
    """The law and its reference. `limits` may change in flight."""

    def __init__(self, config: GuidanceConfig) -> None:
        forward, right, self._down = config.slot_m
        self._config = config
        self.distance, self._side = math.hypot(forward, right), math.atan2(right, forward)
        given = config.min_distance_m
        self.min_distance = 0.85 * self.distance if given is None else min(given, self.distance)
        self.limits = Limits(config.max_speed_m_s, config.max_acceleration_m_s2)
        self.phase = Phase.HOLD
        self.is_range_unsure = False  # the range is too uncertain to close in to the slot
        self._reference: ReferenceState | None = None

    @property
    def has_begun(self) -> bool:
        """Whether there is a reference."""
        return self._reference is not None

    def begin(self, r_F: Array, v_F: Array, yaw: float) -> ReferenceState:
        """Start the reference at the vehicle's position, with its velocity."""
        self.phase = Phase.HOLD
        self._reference = ReferenceState(r_F, v_F, np.zeros(3), yaw, 0.0)
        return self._reference

    def shift(self, step: Array) -> None:
        """Move the reference by `step` (3,): a reset has moved the origin of n."""
        if self._reference is not None:
            self._reference = self._reference._replace(r=self._reference.r + step)

    def step(
        self, leader: LeaderTrack, outage_s: float, turn_rate: float, r_F: Array | None, dt: float, lift: float
    ) -> ReferenceState:
        """Advance the reference by `dt` s. It brakes while our own position `r_F` is not known.

        `outage_s`: since the leader was seen. `turn_rate`: of the slot's course, rad/s. `lift`: m, added to the
        slot's height (down)."""
        before = self._reference
        assert before is not None  # noqa: S101 - `begin` comes first
        self.is_range_unsure = False
        if r_F is None or not leader.is_known or outage_s > FOLLOW_TIMEOUT_S + LOOK_DURATION_S:
            self.phase = Phase.HOLD
        else:
            self.phase = Phase.STOP if outage_s > FOLLOW_TIMEOUT_S else Phase.FOLLOW
        r_F = before.r if r_F is None else r_F
        if self.phase is Phase.FOLLOW:
            after = self._follow(before, leader, turn_rate, r_F, dt, lift)
        else:
            v = np.zeros(3) if self.phase is Phase.HOLD else self._retreat_velocity(before, leader)
            after = self._advance(before, v, np.zeros(3), dt)
        r = r_F + limit_length(after.r - r_F, MAX_REFERENCE_DISTANCE_M)
        self._reference = after = self._point_nose(after._replace(r=r), leader, r_F)
        return after

    def max_turn_rate(self, leader: LeaderTrack) -> float:
        """Greatest rate (rad/s) at which the vehicle can follow a slot about the leader.

        At rate w and distance d the slot moves at w d across the leader's speed v, with an acceleration of
        w sqrt(v^2 + (w d)^2)."""
        d, limits = self.distance, self.limits
        speed = math.hypot(*leader.v[:2])
        square, lean = speed * speed, 2.0 * d * limits.acceleration
        by_acceleration = math.sqrt(0.5 * (math.sqrt(square * square + lean * lean) - square)) / d
        return min(by_acceleration, math.sqrt(max(limits.speed**2 - square, MIN_TURN_SPEED_M_S**2)) / d)

    def _follow(
        self, before: ReferenceState, leader: LeaderTrack, turn_rate: float, r_F: Array, dt: float, lift: float
    ) -> ReferenceState:
        """Advance the reference towards the slot, in polar coordinates about the leader."""
        d, max_rate = self.distance, self.max_turn_rate(leader)
        outward = before.r[:2] - leader.r[:2]
        rho = max(float(np.linalg.norm(outward)), 0.1)
        u = outward / rho
        distance = min(rho, max(float(np.linalg.norm(r_F[:2] - leader.r[:2])), 0.1))
        sigma = sigma_along(leader.range_covariance[:2, :2], u)
        nearest = distance * math.exp(-2.0 * sigma / max(distance, 1.0))
        self.is_range_unsure = nearest < self.min_distance <= distance

        angle = wrap_angle(leader.slot_course + self._side - math.atan2(u[1], u[0]))
        rate = min(max(TURN_GAIN * angle + turn_rate, -max_rate), max_rate)
        error = d - rho if rho > d else max(d - rho - max(sigma - RANGE_SIGMA_TOLERANCE_M, 0.0), 0.0)
        radial = min(max(_stopping_speed(error), -self._config.max_closing_speed_m_s), MAX_RETREAT_SPEED_M_S)
        speed, sure_speed = float(leader.v[:2] @ u), self._sure_speed(leader, u, nearest)
        max_closing = _max_closing_speed(max(nearest - self.min_distance, 0.0), max(-sure_speed, 0.0))
        radial = max(radial, -max_closing)
        across = min(rho, d) * rate  # from afar straight to the slot

        v_L = leader.v[:2] + (sure_speed - speed) * u
        level = self._evade(v_L + radial * u + across * np.array([-u[1], u[0]]), before, leader)
        v = np.array([*level, self._climb_speed(before, leader, lift)])
        a_L = leader.a[:2] if nearest > self.min_distance - 5.0 else np.zeros(2)
        a_L = a_L - max(float(a_L @ u), 0.0) * (1.0 - min(max(sure_speed, 0.0) / max(speed, 0.1), 1.0)) * u
        a = np.array([*(a_L - min(rho, d) * rate * rate * u), 0.0])
        return self._advance(before, v, a, dt, (u, self._max_braking(before, leader, u, distance)))

    def _evade(self, v: Array, before: ReferenceState, leader: LeaderTrack) -> Array:
        """Limit velocity v (2,), and leave the path of an oncoming leader sideways."""
        limit, speed = self.limits.speed, max(float(np.linalg.norm(leader.v[:2])), 0.1)
        outward = before.r[:2] - leader.r[:2]
        path = leader.v[:2] / speed
        ahead = float(outward @ path)  # m, until the leader passes us
        aside = outward - ahead * path
        miss, passing = float(np.linalg.norm(aside)), PASSING_DISTANCE_RATIO * self.distance
        oncoming = speed * ahead / max(float(np.linalg.norm(outward)), 0.1)
        if oncoming < MIN_ONCOMING_SPEED_M_S + 0.5 * sigma_along(leader.covariance[3:5, 3:5], path):
            return limit_length(v, limit)
        side = np.array([-path[1], path[0]])
        moving = before.v[:2] if abs(float(before.v[:2] @ side)) > MIN_ONCOMING_SPEED_M_S else v
        side = side * math.copysign(1.0, float((aside if miss > MIN_MISS_DISTANCE_M else moving) @ side))
        needed = min((passing - miss) * speed / ahead, MAX_EVASION_SPEED_RATIO * limit)
        across = max(min(max(float(v @ side), needed), limit), -limit)
        along = limit_length(float(v @ path) * path, math.sqrt(limit * limit - across * across))
        return along + across * side

    def _sure_speed(self, leader: LeaderTrack, u: Array, nearest: float) -> float:
        """The leader's speed along u (2,), outward, as far as it is certain.

        The vehicle retreats only from a certain approach. It follows a leader that flies off more slowly, by the
        uncertainty of its speed, the likelier the leader is nearer than the slot's distance."""
        smooth, estimated = float(leader.v[:2] @ u), float(leader.v_estimated[:2] @ u)
        if smooth > 0.0:
            speed = min(smooth, estimated + SPEED_NOISE_M_S)
        else:
            speed = max(smooth, min(estimated - SPEED_NOISE_M_S, 0.0))
        speed += LEAD_TIME_S * min(float(leader.a[:2] @ u), 0.0)
        sigma = sigma_along(leader.covariance[3:5, 3:5], u)
        if speed > 0.0:
            return max(speed - max(1.5 * sigma - 1.0, 0.0), 0.0)
        doubt = min(max((self.distance - nearest) / (0.25 * self.distance), 0.0), 1.0)
        return min(speed + max((1.0 + doubt) * sigma - SPEED_NOISE_M_S, 0.0), 0.0)

    def _max_braking(self, before: ReferenceState, leader: LeaderTrack, u: Array, distance: float) -> float:
        """Greatest braking (m/s^2) before the leader, which stays in view unless we must stop."""
        closing = float((leader.v - before.v)[:2] @ u)
        needed = closing * closing / (2.0 * max(distance - self.min_distance, 1.0)) if closing > 0.0 else 0.0
        room = (distance - self.min_distance) / max(self.distance - self.min_distance, 1.0)
        limit = self.limits.acceleration
        gentle = limit - min(max(room, 0.0), 1.0) * (limit - MAX_ACCELERATION_IN_VIEW_M_S2)
        return min(max(gentle, needed + float(leader.a[:2] @ u)), limit)

    def _climb_speed(self, before: ReferenceState, leader: LeaderTrack, lift: float) -> float:
        """Vertical velocity (m/s, down) to the slot's height, which is at least `min_height_m`."""
        height = min(float(leader.r[2]) + self._down + lift, -self._config.min_height_m)
        sure = max(abs(float(leader.v[2])) - math.sqrt(max(leader.covariance[5, 5], 0.0)), 0.0)
        v = CLIMB_GAIN * (height - before.r[2]) + math.copysign(sure, leader.v[2])
        return float(min(max(v, -MAX_CLIMB_SPEED_M_S), MAX_CLIMB_SPEED_M_S))

    def _retreat_velocity(self, before: ReferenceState, leader: LeaderTrack) -> Array:
        """Velocity (3,) away from a lost leader that should be nearer than the slot's distance."""
        outward = before.r[:2] - leader.r[:2]
        rho = max(float(np.linalg.norm(outward)), 0.1)
        error = self.distance - rho - sigma_along(leader.range_covariance[:2, :2], outward / rho)
        if error <= 0.0:
            return np.zeros(3)
        oncoming = float(leader.v[:2] @ outward) / rho - sigma_along(leader.covariance[3:5, 3:5], outward / rho)
        speed = _stopping_speed(error) + max(oncoming, 0.0)
        return np.array([*(min(speed, self.limits.speed) / rho * outward), 0.0])

    def _advance(
        self, before: ReferenceState, v: Array, a: Array, dt: float, braking: tuple[Array, float] | None = None
    ) -> ReferenceState:
        """Advance the reference by `dt` s towards velocity v, with acceleration a fed forward.

        `braking`: a direction (2,) and the greatest acceleration along it."""
        limits = self.limits
        wanted = a + VELOCITY_GAIN * (v - before.v)
        limit = limits.acceleration if braking else min(FOLLOWER_ACCELERATION_M_S2, limits.acceleration)
        level = limit_length(wanted[:2], limit)
        if braking is not None:
            u, max_braking = braking
            level = level - max(float(level @ u) - max_braking, 0.0) * u
        climb = min(max(float(wanted[2]), -MAX_CLIMB_ACCELERATION_M_S2), MAX_CLIMB_ACCELERATION_M_S2)
        a = before.a + limit_length(np.array([*level, climb]) - before.a, limits.jerk * dt)
        v = before.v + dt * a
        v[:2] = limit_length(v[:2], limits.speed)
        return before._replace(r=before.r + dt * v, v=v, a=a)

    def _point_nose(self, after: ReferenceState, leader: LeaderTrack, r_F: Array) -> ReferenceState:
        """Point the reference's nose to the leader, at the rate of its bearing."""
        x, y = (leader.r - r_F)[:2].tolist()
        if self.phase is Phase.HOLD or math.hypot(x, y) < MIN_BEARING_DISTANCE:
            return after._replace(yaw_rate=0.0)
        vx, vy = (leader.v - after.v)[:2].tolist()
        rate, limit = (x * vy - y * vx) / (x * x + y * y), self.limits.yaw_rate
        return after._replace(yaw=math.atan2(y, x), yaw_rate=min(max(rate, -limit), limit))


def _stopping_speed(distance: float) -> float:
    """Speed (m/s) from which to come to rest at a distance (m)."""
    linear = APPROACH_ACCELERATION_M_S2 / (APPROACH_GAIN * APPROACH_GAIN)
    if abs(distance) <= linear:
        return APPROACH_GAIN * distance
    return math.copysign(math.sqrt(2.0 * APPROACH_ACCELERATION_M_S2 * (abs(distance) - 0.5 * linear)), distance)


def _max_closing_speed(gap: float, speed: float) -> float:
    """Closing speed from which we stop within a gap to a leader that flies off and brakes."""
    lag = REACTION_TIME_S * FOLLOWER_ACCELERATION_M_S2
    room = gap + speed * speed / (2.0 * LEADER_ACCELERATION_M_S2)
    total = math.sqrt(lag * lag + 2.0 * FOLLOWER_ACCELERATION_M_S2 * room) - lag
    return max(total - speed, 0.0)
