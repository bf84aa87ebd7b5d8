"""The truth of an encounter, as arrays over time."""

from typing import NamedTuple

import numpy as np

from simlink.encounters.curves import Motion
from simlink.sensors.arrays import Array


class EncounterTruth(NamedTuple):
    """N times `t` (s of the encounter), motions in n, Euler angles (N, 3) as in `attitudes`. The leader is L, the
    follower F."""

    t: Array
    leader: Motion
    euler_L: Array
    follower: Motion
    euler_F: Array

    @property
    def r_FL_n(self) -> Array:
        """The leader relative to the follower (N, 3), m."""
        return self.leader.r - self.follower.r

    @property
    def v_FL_n(self) -> Array:
        """Its velocity relative to the follower's (N, 3), m/s."""
        return self.leader.v - self.follower.v


def at(t: Array, truth: Array, when: Array) -> Array:
    """Rows of `truth` (N, k) at the times `when` (M,), linear between two: (M, k)."""
    return np.column_stack([np.interp(when, t, x) for x in truth.T])
