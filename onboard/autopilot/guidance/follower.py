"""What differs between autopilots that follow."""

import math
from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.motion import Sent, Slot, SmoothedLeader
from onboard.messages import Heartbeat

NEAR_SIGMAS: Final = 2.0  # the near end of the covariance
NEAR_SHARE: Final = 2.0 / 3.0  # of the slot's distance, that is left to it
NOISE: Final = 0.5  # m/s, of a speed that is no doubt
BRAKING: Final = 2.2  # m/s^2: less than ArduPilot's 2.5, so that it stops where it is meant to
INSIDE: Final = 0.9  # of the slot's distance: nearer, the smoothed leader no longer decides


class Follower(Protocol):
    """The mode of an autopilot that follows: what it makes of a target, so what it is to be sent. It keeps nothing
    of what it was asked for before but its own smooth trajectory."""

    when_lost: str  # what it does once the leader is lost, in at most 35 characters
    begins: float | None  # rad, the nose with which it stays if it begins on its last target; None: it forgets it
    speed_parameters: Mapping[str, float]  # that hold its own limit of speed, by version, and m/s of their unit
    speed_m_s: float  # that limit, as far as it is known
    leads_round: bool  # it flies where it is led about the leader, and at the height at which it is led

    def is_entered(self, heartbeat: Heartbeat) -> bool | None:
        """Whether the autopilot follows, by its heartbeat; None: it does not say."""

    def restart(self) -> None:
        """Forget the leader."""

    def turn_limits(self, v: Array, arm: Array) -> tuple[float, float]:
        """The least and the greatest rate, rad/s, at which a slot `arm` (3,) m from a leader with velocity v can
        turn about it."""

    def follow(self, track: SmoothedLeader, slot: Slot, r_L: Array, v_L: Array, r_F: Array, dt: float) -> Sent:
        """Where to fly, behind a leader that is smoothed as `track` and estimated at r_L with v_L."""

    def stop(self, place: Array, v_F: Array, yaw: float, *, brakes: bool) -> Sent:
        """How to come to rest at a place, with the nose at `yaw`."""

    def target(self, sent: Sent, slot: Slot, dt: float) -> Sent:
        """The target to send `dt` s after the one before, so that the vehicle flies as `sent`."""

    def passes(self, r: Array, v_F: Array, v_L: Array) -> str:
        """What to do instead, in words, where the way that it takes when it begins to follow passes the leader;
        else "". `r`: our place from the leader, n; both velocities, n."""


def kept_away(r: Array, r_L: Array, r_F: Array, yaw: Array, slot: Slot) -> Array:
    """The place nearest to r that is far enough from the leader and not too far. Where we are farther away
    already, we need not come nearer; where we are nearer, we go straight away as far as is firm, and stay
    beyond."""
    away, here = r - r_L, float(np.linalg.norm(r_F - r_L))
    distance = float(np.linalg.norm(away))
    if distance < 1e-3:
        return r_L - slot.firm * yaw
    beside = math.hypot(r_F[0] - r_L[0], r_F[1] - r_L[1])
    if here < slot.firm and beside > 1e-3:
        away[:2] = (r_F - r_L)[:2] * (math.hypot(away[0], away[1]) / beside)
    least = min(slot.room, max(here, slot.firm))
    return r_L + away * (min(max(distance, least), max(slot.most, here)) / distance)


def surely_closing(r: Array, r_L: Array, v_L: Array, slot: Slot, left: float, lag_s: float = 0.0) -> float:
    """The speed toward the leader, m/s over ground, from which one at r can stop `left` m before the near end (2
    sigma) of where the leader may be and of how fast it may come. What is unsure makes nobody flee: it is no less
    than the leader's own as estimated, where that comes, and else a standstill. `lag_s`: until it begins to
    brake."""
    away = r_L - r
    distance = max(float(np.linalg.norm(away)), 1e-3)
    recedes = float(v_L @ away) / distance
    may_come = NEAR_SIGMAS * slot.speed_sigma - NOISE
    return max(recedes - max(may_come, 0.0) + stopping(distance - slot.nearer - left, lag_s), min(recedes, 0.0))


def stopping(way: float, lag_s: float = 0.0) -> float:
    """The speed from which it stops within a way, m/s, when it begins to brake after `lag_s`."""
    lost = BRAKING * lag_s
    return math.sqrt(lost * lost + 2.0 * BRAKING * max(way, 0.0)) - lost
