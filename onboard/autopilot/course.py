"""The leader's course, which a follower's slot is behind."""

import math
from typing import Final

from onboard.arrays import Array

SLOW: Final = 1.0  # m/s; a slower leader keeps its last course
SURE: Final = 4.0  # sigmas of the speed: during a take-off 2.7 of them were noise
SURE_FOR: Final = 1.0  # s, before the course is learnt
BACK, AHEAD = math.radians(100.0), math.radians(80.0)  # beyond, it backs up; from within, it no longer does


class Course:
    """Learnt from a velocity that is surely not noise, and held in a hover. It never flips: a leader that backs up
    or reverses keeps it. `value` in rad; not `is_learnt` while it is only supposed."""

    def __init__(self) -> None:
        self.value: float | None = None
        self.is_learnt = False
        self._sure_for = 0.0
        self._backs_up = False

    def start(self, course: float) -> None:
        """Suppose a course until one is learnt."""
        self.value = course

    def resume(self, course: float) -> None:
        """Go on with a course that was learnt."""
        self.value, self.is_learnt = course, True

    def learn(self, v: Array, sigma: float, dt: float) -> None:
        """Take the velocity (n, m/s) after a further `dt` s."""
        speed = math.hypot(v[0], v[1])
        if speed <= max(SLOW, SURE * sigma):
            self._sure_for = 0.0
            return
        self._sure_for += dt
        if not self.is_sure:
            return
        course = math.atan2(v[1], v[0])
        if self.value is not None:
            change = abs(wrapped(course - self.value))
            self._backs_up = change > (AHEAD if self._backs_up else BACK)
        if not self._backs_up:
            self.value, self.is_learnt = course, True

    @property
    def is_sure(self) -> bool:
        """The leader moves: its velocity is not noise."""
        return self._sure_for >= SURE_FOR

    def rate(self, v: Array, a: Array) -> float:
        """The rate at which it turns, rad/s; 0 while it is held."""
        return 0.0 if self._backs_up or not self.is_sure else self.rate_of(v, a)

    @staticmethod
    def rate_of(v: Array, a: Array) -> float:
        """The rate at which a velocity turns, rad/s; 0 where it is slow."""
        square = float(v[0] * v[0] + v[1] * v[1])
        return 0.0 if square < SLOW else float(v[0] * a[1] - v[1] * a[0]) / square


def wrapped(angle: float) -> float:
    """An angle in [-pi, pi], rad."""
    return math.remainder(angle, 2.0 * math.pi)
