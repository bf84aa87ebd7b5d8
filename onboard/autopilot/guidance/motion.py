"""The smoothed leader, and what is to be flown to."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.carried import carried

ACCELERATION_RATE: Final = 5.0  # 1/s, with which the acceleration is smoothed
VELOCITY_RATE: Final = 1.2  # 1/s, with which the velocity is
POSITION_RATE: Final = 0.4  # rad/s, with which the position is
NOISE: Final = (0.4, 0.6)  # m/s, m: errors that are seldom noise raise the bandwidth
MOST_FASTER: Final = 4.0
CATCHES_UP: Final = 4.0  # m/s, by which it is faster than the leader: a range that is found anew is no motion
MOST_ACCELERATION: Final = 4.0  # m/s^2, of the smoothed leader

FORWARD: Final = np.array([1.0, 0.0, 0.0])


class SmoothedLeader(NamedTuple):
    """The smoothed leader: position and its derivative, and velocity and acceleration as observed (m, NED)."""

    r: Array
    v: Array
    v_observed: Array
    a: Array


class Sent(NamedTuple):
    """Position, velocity and acceleration of what is to be flown to, n, and the heading to have (rad). The
    acceleration is that of the turn and of braking only: an autopilot carries it on for as long as it waits for
    the next message. `stands`: a place to come to rest at, and not one that goes with the leader."""

    r: Array
    v: Array
    a: Array
    yaw: float
    stands: bool = False


class Slot(NamedTuple):
    """Where the follower belongs: its place from the leader (3,) in n, m, and the rate at which that turns about
    the leader, rad/s. `yaw`: from us to the leader, rad. From the leader as estimated, m: `room`, nearer than
    which it is not led; `firm`, up to which it is led away from a leader that is nearer; `most`, the greatest
    distance; `nearer`, by which the near end of the range is nearer. `speed_sigma`: of the leader's speed along
    the range, m/s. `is_entered`: nothing says that the autopilot is in another mode. `flies`: the leader does."""

    arm: Array
    turn_rate: float
    yaw: float
    room: float
    firm: float
    most: float
    nearer: float
    speed_sigma: float
    is_entered: bool
    flies: bool


def smoothed(track: SmoothedLeader | None, r: Array, v: Array, a_L: Array, dt: float) -> SmoothedLeader:
    """The smoothed leader after `dt` s, when it is estimated at r, with v and a_L. Velocity and acceleration are
    smoothed first; then position and its derivative follow them, as one trajectory. What is too large for noise is
    followed faster."""
    if track is None:
        return SmoothedLeader(r, v, v, a_L)
    away, behind = v - track.v_observed, r - (track.r + dt * track.v)
    a = track.a + min(dt * ACCELERATION_RATE, 1.0) * (limited(a_L, MOST_ACCELERATION) - track.a)
    v_observed = track.v_observed + dt * (a + VELOCITY_RATE * _faster(away, NOISE[0]) * away)
    rate = POSITION_RATE * _faster(behind, NOISE[1])
    pull = 2.0 * rate * (v_observed - track.v) + rate**2 * behind
    v_next = track.v + dt * limited(a + pull, 2.0 * MOST_ACCELERATION)
    v_next = v_observed + limited(v_next - v_observed, CATCHES_UP)
    return SmoothedLeader(track.r + dt * v_next, v_next, v_observed, a)


def flown_on(track: SmoothedLeader, turn_rate: float, dt: float) -> SmoothedLeader:
    """The leader `dt` s later, if it flies on as it did, turns included."""
    r, v = carried(track.r, track.v, turn_rate, dt)
    return SmoothedLeader(r, v, v, turn_rate * across(v))


def _faster(error: Array, noise: float) -> float:
    return min(max(float(np.linalg.norm(error)) / noise, 1.0), MOST_FASTER)


def across(v: Array) -> Array:
    """A horizontal vector turned by 90 degrees to the right."""
    return np.array([-v[1], v[0], 0.0])


def level(v: Array) -> Array:
    """A vector without its height."""
    return np.array([v[0], v[1], 0.0])


def turned(v: Array, yaw: float) -> Array:
    """A vector forward, right, down of a heading, in n."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


def sigma_along(P: Array, direction: Array) -> float:
    """The standard deviation along a direction."""
    length = float(np.linalg.norm(direction))
    if length < 1e-3:
        return math.sqrt(float(np.linalg.eigvalsh(P)[-1]))
    u = direction / length
    return math.sqrt(max(float(u @ P @ u), 0.0))


def limited(v: Array, most: float) -> Array:
    """A vector no longer than that."""
    size = float(np.linalg.norm(v))
    return v if size <= most else v * (most / size)
