"""The truth of an encounter, as arrays over time and as states of the world."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from simlink.encounters.curves import Motion
from simlink.sensors.arrays import Array
from simlink.world import attitude, truth
from simlink.world.truth import State, body_rate, make_state


class EncounterTruth(NamedTuple):
    """The truth at N times `t` (s): motions in n and Euler angles (N, 3).

    The leader is L, the follower F, another aircraft O.
    """

    t: Array
    leader: Motion
    euler_L: Array
    follower: Motion
    euler_F: Array
    other: Motion | None = None
    euler_O: Array | None = None

    @property
    def r_FL_n(self) -> Array:
        """The leader relative to the follower (N, 3), m."""
        return self.leader.r - self.follower.r

    @property
    def v_FL_n(self) -> Array:
        """The leader's velocity relative to the follower (N, 3), m/s."""
        return self.leader.v - self.follower.v


def states(flown: EncounterTruth) -> Iterator[State]:
    """The world, step by step."""
    vehicles = [_motions(flown.leader, flown.euler_L), _motions(flown.follower, flown.euler_F)]
    if flown.other is not None and flown.euler_O is not None:
        vehicles.append(_motions(flown.other, flown.euler_O))
    for step, (t, leader, follower, *others) in enumerate(zip(flown.t.tolist(), *vehicles, strict=True)):
        yield make_state(step, t, leader, follower)._replace(others=tuple(others))


def at(t: Array, values: Array, when: Array) -> Array:
    """Interpolate rows of `values` (N, k) linearly at the times `when` (M,): (M, k)."""
    return np.column_stack([np.interp(when, t, x) for x in values.T])


def _motions(motion: Motion, euler: Array) -> Iterator[truth.Motion]:
    before = None
    for (*r, vx, vy, vz, ax, ay, az), angles in zip(np.hstack(motion).tolist(), euler.tolist(), strict=True):
        q = attitude.from_euler(*angles)
        yield truth.Motion((r[0], r[1], r[2]), (vx, vy, vz), (ax, ay, az), q, body_rate(before, q))
        before = q
