"""The leader's course, which a follower's slot is behind."""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.motion import across, sigma_along
from onboard.autopilot.guidance.states import MOTIONS, Activity, Event, Machine
from onboard.geometry.carried import turn_rate

SLOW: Final = 1.0  # m/s; a slower leader keeps its last course
FAST, FAST_SIGMAS = 2.0, 2.5  # m/s, of a leader that sets off: of a hover, its estimate has up to 1.3
SURE: Final = 4.0  # sigmas from a standstill, and across the course: during a take-off 2.7 of them were noise
KEEPS: Final = 2.0  # sigmas across, while it flies on: its direction is then known to 27 degrees
CREEPS: Final = 1.5  # m/s; one that turns round is not so slow, one that flies back is
SURE_FOR: Final = 1.0  # s, before the course is learnt
BACK, AHEAD = math.radians(100.0), math.radians(80.0)  # beyond, it backs up; from within, it no longer does


class Course:
    """Learnt from a velocity that is surely not noise, then kept up in a turn of any size, and held in a hover. A
    velocity that passes through zero and comes back from the other side is that of a leader that backs up: the
    course stays, for as long as `motion` is so. One that turns round is not slow meanwhile, however unsure it is.
    `value` in rad; not `is_learnt` while it is only supposed."""

    def __init__(self) -> None:
        self.value: float | None = None
        self.is_learnt = False
        self.motion = Machine(MOTIONS, Activity.RESTS)
        self._sure_for = 0.0

    def start(self, course: float) -> None:
        """Suppose a course until one is learnt."""
        self.value = course

    def resume(self, course: float, v: Array) -> None:
        """Go on with a course that was learnt, of a leader that flew with v (n, m/s)."""
        self.value, self.is_learnt = course, True
        if math.hypot(v[0], v[1]) > SLOW:
            self.motion.enter(Activity.BACKS_UP if self._away(v) > BACK else Activity.FLIES)

    def _away(self, v: Array) -> float:
        """The angle between a velocity and the course, rad."""
        return 0.0 if self.value is None else abs(wrapped(math.atan2(v[1], v[0]) - self.value))

    def learn(self, v: Array, P: Array, dt: float) -> None:
        """Take the velocity (n, m/s), of covariance P (3, 3), after a further `dt` s. Where the range is unsure,
        so is the velocity along it; that across is known, and tells whether it flies."""
        speed, sigma = math.hypot(v[0], v[1]), sigma_along(P, across(v))
        moves = math.sqrt(float(v[:2] @ np.linalg.solve(P[:2, :2], v[:2])))  # sigmas
        is_sure = speed > max(SLOW, SURE * sigma) and moves > SURE
        self._sure_for = self._sure_for + dt if is_sure else 0.0
        away, backed_up = self._away(v), self.backs_up
        self.motion.step(
            {
                Event.CREEPS: speed <= CREEPS,
                Event.SLOW: speed <= SLOW,
                Event.MOVES: speed > SLOW,
                Event.MAY_REST: moves <= FAST_SIGMAS,
                Event.FAST: speed > FAST and moves > FAST_SIGMAS,
                Event.AGAINST: self.is_sure and away > BACK,
                Event.ALONG: self.is_sure and away < AHEAD,
            },
            dt,
        )
        flies_on = self.motion.state is Activity.FLIES and (
            backed_up or (self.is_learnt and speed > KEEPS * sigma)
        )
        if flies_on or (self.is_sure and not self.backs_up):
            self.value, self.is_learnt = math.atan2(v[1], v[0]), True

    @property
    def backs_up(self) -> bool:
        """The leader flies against its course."""
        return self.motion.state is Activity.BACKS_UP

    @property
    def is_sure(self) -> bool:
        """The leader moves: its velocity is not noise."""
        return self._sure_for >= SURE_FOR

    def rate(self, v: Array, a: Array) -> float:
        """The rate at which it turns, rad/s; 0 while it is held."""
        return (
            turn_rate(v, a) if self.motion.state is Activity.FLIES or (self.is_sure and not self.backs_up) else 0.0
        )


def wrapped(angle: float) -> float:
    """An angle in [-pi, pi], rad."""
    return math.remainder(angle, 2.0 * math.pi)
