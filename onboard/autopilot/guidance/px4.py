"""PX4's Follow-Me, read in the sources of 1.17 (`FlightTaskAutoFollowTarget.cpp`, `TargetEstimator.cpp`).

It takes the target's position at most every 0.5 s and its velocity every 0.1 s, smooths both, and flies on a
circle of `FLW_TGT_DST` about the target, at the angle of the target's **course** plus `FLW_TGT_FA`, with its nose
on the target. The course is that of the velocity above 1 m/s, and north at first; the angle moves with at most
`FLW_TGT_MAX_VEL`, and begins **north of the target** whenever the mode is entered, wherever the vehicle is.
Heading, acceleration, and by `FLW_TGT_ALT_M` 0 the altitude of the message do not count. 3 s after the last
message the target stands still, and the vehicle flies on to its place about it.

So it is sent the smoothed leader with its own velocity. The target is shifted along the line from us only, as far
as the distance needs it: what is tied to our own place comes back to it late, and makes it swing.

**What is sent is one trajectory**: a position that leaps is a velocity to PX4's filters, so a course, and the
vehicle sets out for another side of the target. A real one that orbited a leader at rest came within 5 m of it so,
when the range became unsure. So each target is the one before, moved by the velocity that is sent with it, save
after silence.

**It begins on the last target that it has, however old**: silence does not keep it from passing the leader. Where
it may not begin, it is sent a target whose circle begins at the place where the vehicle is.

**Its course of a leader at rest is ours to state.** Left at north, it takes the vehicle to the south, and a leader
that flies off there comes at it. So the last target before the mode is entered has a small velocity away from the
vehicle, and stays behind it. Later that would not do: a real one swung by 45 degrees to both sides on it.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.follower import NEAR_SHARE, kept_away, surely_closing
from onboard.autopilot.guidance.motion import FORWARD, Sent, Slot, SmoothedLeader, level, limited, turned
from onboard.config import GuidanceConfig
from onboard.messages import Heartbeat

FOLLOW_ME: Final = 8 << 24 | 4 << 16  # custom_mode AUTO, FOLLOW_TARGET
MOVES: Final = 1.0  # m/s, from which a velocity sets its course
FLIES: Final = 2.0  # m/s, of a target that is on its way
STILL: Final = 0.8  # m/s, of a velocity that may be noise and must not set it
TURNS: Final = 1.3  # m/s, of one that is to set it
BEGINS_S: Final = 0.6  # s, after the mode is entered: until its filters have begun with it
PULL: Final = 0.8  # 1/s, at which the target closes up to where it belongs
ASIDE: Final = 0.4  # of the leader's speed, at most, so that closing up hardly turns the course
CREEPS: Final = 0.4  # m/s, of one that stands
LEAPS: Final = 20.0  # m; it begins anew rather than travel farther
QUICKER, BRAKES = 3.0, 5.0  # m/s^2, of the target
LAG_S: Final = 2.4  # from a place ahead to the speed with which it is approached: 1 / MPC_XY_P, and the filters
FILTERS_S: Final = 1.0  # until a velocity that it is sent changes its own
POSITION_GAIN, RESPONSE_S, SPEED = 0.95, 0.6, 12.0  # MPC_XY_P, s, MPC_XY_VEL_MAX
# m/s, FLW_TGT_MAX_VEL where the vehicle does not say: 30 m behind a leader that turns at 0.2 rad/s it is 6
ORBIT_SPEED: Final = 8.0
SPEED_PARAMETERS: Final = {"FLW_TGT_MAX_VEL": 1.0}  # m/s of its unit
AWAY: Final = 0.9  # of the distance that it has: a way that goes nearer does not go away
HIGHER: Final = 8.0  # m, at which it may pass above or below the leader
STEP_S, AHEAD_S = 0.25, 20.0  # s, of the prediction of its way
PASSES: Final = "PX4 will pass the leader: begin north of it, or 8 m higher"


class Px4:
    """The leader itself. `FLW_TGT_DST` and `FLW_TGT_FA` are taken to be those of `slot_m`."""

    when_lost = "Follow-Me is led to a stop"
    begins: float | None = math.pi  # north of its target
    leads_round = False
    speed_parameters: Mapping[str, float] = SPEED_PARAMETERS

    def __init__(self, config: GuidanceConfig) -> None:
        x, y, _ = config.slot_m
        self._distance, self._angle = max(math.hypot(x, y), 1.0), math.atan2(y, x)
        self.speed_m_s = ORBIT_SPEED  # about its target
        self._closes = config.closing_speed_m_s
        distance = float(np.linalg.norm(config.slot_m))
        least = config.least_distance_m
        self._least = 0.5 * distance if least is None else min(least, distance)
        self.restart()

    def is_entered(self, heartbeat: Heartbeat) -> bool:
        """Whether it is in Follow-Me."""
        return heartbeat.custom_mode == FOLLOW_ME

    def restart(self) -> None:
        """Forget the leader."""
        self._entered_for = math.inf  # s; it has a course
        self._sent: Sent | None = None  # the target before

    def turn_limits(self, v: Array, arm: Array) -> tuple[float, float]:  # noqa: ARG002 - it has its own limit
        """`FLW_TGT_MAX_VEL`."""
        most = self.speed_m_s / max(math.hypot(arm[0], arm[1]), 1.0)
        return -most, most

    def follow(
        self,
        track: SmoothedLeader,
        slot: Slot,
        r_L: Array,
        v_L: Array,
        r_F: Array,
        dt: float,  # noqa: ARG002
    ) -> Sent:
        """On the circle about the leader, where the vehicle is. It flies with the velocity that is sent, and
        closes up to the place: both together are no faster toward the leader than it can stop from."""
        toward = turned(FORWARD, slot.yaw)
        r = track.r - math.hypot(slot.arm[0], slot.arm[1]) * toward
        r[2] = r_F[2]
        r = kept_away(r, r_L, r_F, toward, slot)
        ahead, v = limited(r - r_F, LAG_S * self._closes), track.v
        most = surely_closing(level(r_F), level(r_L), level(v_L), slot, NEAR_SHARE * self._distance, FILTERS_S)
        v = v - max(float(v @ toward) - most, 0.0) * toward
        ahead = ahead - max(float(ahead @ toward) - LAG_S * max(most - float(v @ toward), 0.0), 0.0) * toward
        r = r_F + ahead
        return Sent(np.array([r[0], r[1], track.r[2]]), v, np.zeros(3), slot.yaw)

    def stop(self, place: Array, v_F: Array, yaw: float, *, brakes: bool) -> Sent:  # noqa: ARG002
        """At a standstill. A small velocity turns its course to us, so that it does not circle the place. The last
        message has it yet: its filter carries on a velocity that ends as one that turns round."""
        return Sent(place, np.zeros(3), np.zeros(3), yaw, stands=True)

    def target(self, sent: Sent, slot: Slot, dt: float) -> Sent:
        """The centre of the circle, on from the one before. Before the mode is entered there is none."""
        self._entered_for = self._entered_for + dt if slot.is_entered else 0.0
        aim, before = sent._replace(r=sent.r + self._distance * turned(FORWARD, sent.yaw)), self._sent
        if before is None or not slot.is_entered or math.dist(aim.r[:2], before.r[:2]) > LEAPS:
            v = self._sure(aim, slot)
        else:
            most = CREEPS if sent.stands else max(STILL, ASIDE * math.hypot(sent.v[0], sent.v[1]))
            back = limited(PULL * level(aim.r - before.r - dt * sent.v), most)
            v = self._sure(sent._replace(v=sent.v + back), slot)
            slows = sent.stands or math.hypot(v[0], v[1]) < math.hypot(before.v[0], before.v[1])
            v = before.v + limited(v - before.v, (BRAKES if slows else QUICKER) * dt)
            r = before.r + dt * v
            r[2] = aim.r[2]
            aim = aim._replace(r=r)
        self._sent = aim._replace(v=v)
        return self._with_course(self._sent, sent, slot)

    def _course(self, at: Array, sent: Sent, slot: Slot) -> Array:
        """That a target at `at` is to have, level, of length 1: behind a leader at rest the slot's, and of a place
        to stay at that with which its circle leads there."""
        side = level(sent.r - at) if sent.stands else level(slot.arm)
        size = math.hypot(side[0], side[1])
        return turned(side / size if size > 1.0 else -turned(FORWARD, sent.yaw), -self._angle)

    def _sure(self, sent: Sent, slot: Slot) -> Array:
        """As much of a velocity as is surely the leader's, or sets no other course."""
        if sent.stands or slot.flies:
            return sent.v
        course = self._course(sent.r, sent, slot)
        away = max(float(sent.v @ course), 0.0) * course
        return away + limited(sent.v - away, STILL)

    def _with_course(self, target: Sent, sent: Sent, slot: Slot) -> Sent:
        """With a velocity that sets the course where it stops or begins, and keeps it behind a leader at rest."""
        speed, course = math.hypot(target.v[0], target.v[1]), TURNS * self._course(target.r, sent, slot)
        if sent.stands:
            return target._replace(v=target.v + course) if speed < STILL else target
        if slot.flies or speed >= FLIES:
            return target
        return target._replace(v=course if self._entered_for < BEGINS_S else limited(target.v, STILL))

    def passes(self, r: Array, v_F: Array, v_L: Array) -> str:
        """Its way when it begins, about a leader that flies straight on. Too near already, it may only go away."""
        if abs(r[2]) >= HIGHER:
            return ""
        course = math.atan2(v_L[1], v_L[0]) if math.hypot(v_L[0], v_L[1]) >= MOVES else 0.0
        goal, angle = math.remainder(course + self._angle, 2.0 * math.pi), 0.0
        x, y = float(r[0]), float(r[1])
        vx, vy = float(v_F[0] - v_L[0]), float(v_F[1] - v_L[1])
        turn, nearest = self.speed_m_s / self._distance * STEP_S, math.inf
        for _ in range(round(AHEAD_S / STEP_S)):
            angle += min(max(goal - angle, -turn), turn)
            ex, ey = self._distance * math.cos(angle) - x, self._distance * math.sin(angle) - y
            share = POSITION_GAIN * min(1.0, SPEED / max(POSITION_GAIN * math.hypot(ex, ey), 1e-9))
            vx += STEP_S / RESPONSE_S * (share * ex - vx)
            vy += STEP_S / RESPONSE_S * (share * ey - vy)
            x, y = x + STEP_S * vx, y + STEP_S * vy
            nearest = min(nearest, math.hypot(x, y))
        return PASSES if nearest < min(self._least, AWAY * math.hypot(r[0], r[1])) else ""
