"""What differs between autopilots that follow."""

from typing import Final, Protocol

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.motion import Sent, Slot, Track
from onboard.messages import Heartbeat

INSIDE: Final = 0.9  # of the slot's distance: nearer, the smoothed leader no longer decides


class Follower(Protocol):
    """The mode of an autopilot that follows: what it makes of a target, so what it is to be sent."""

    turn_speed: float  # m/s, about the leader
    when_lost: str  # what it does once the leader is lost, in at most 35 characters
    begins: float | None  # rad, the nose with which it stays if it begins on its last target; None: it forgets it

    def is_entered(self, heartbeat: Heartbeat) -> bool | None:
        """Whether the autopilot follows, by its heartbeat; None: it does not say."""

    def restart(self) -> None:
        """Forget the leader."""

    def waits(self, track: Track, sigma: float, dt: float) -> bool:
        """Whether it is to stay where it is while the range is unsure; `dt` s after the time before. `sigma`: of
        the leader's velocity along itself, m/s."""

    def follow(self, track: Track, slot: Slot, r_L: Array, v_L: Array, r_F: Array, dt: float) -> Sent:
        """Where to fly, behind a leader that is smoothed as `track` and estimated at r_L with v_L. `v_L` is that
        of the near end of its covariance."""

    def stop(self, place: Array, v_F: Array, yaw: float, *, brakes: bool) -> Sent:
        """How to come to rest at a place, with the nose at `yaw`."""

    def target(self, sent: Sent, slot: Slot, dt: float) -> Sent:
        """The target to send `dt` s after the one before, so that the vehicle flies as `sent`."""

    def passes(self, r: Array, v_F: Array, v_L: Array) -> str:
        """What to do instead, in words, where the way that it takes when it begins to follow passes the leader;
        else "". `r`: our place from the leader, n; both velocities, n."""


def kept_away(r: Array, r_L: Array, r_F: Array, yaw: Array, slot: Slot) -> Array:
    """The place nearest to r that is far enough from the leader and not too far. Where we are farther away
    already, we need not come nearer."""
    away = r - r_L
    distance = float(np.linalg.norm(away))
    if distance < 1e-3:
        return r_L - slot.room * yaw
    most = max(slot.most, float(np.linalg.norm(r_F - r_L)))
    return r_L + away * (min(max(distance, slot.room), most) / distance)
