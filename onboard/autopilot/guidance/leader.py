"""The leader as guidance follows it: a smoothed motion, and the course that the slot is behind.

Nothing here decides between manoeuvres. A velocity counts by how surely the leader flies, so a leader that turns
turns the course, one that stops keeps it, and one that flies back turns it round in the time that going round
takes.
"""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.geometry.carried import carried, turn_rate
from onboard.messages import LeaderState

ACCELERATION_TIME_S: Final = 0.4  # time constants of the smoothed motion: estimates come 10 to 30 times a second,
VELOCITY_TIME_S: Final = 0.5  # and position and velocity control of autopilots lag by 0.5 to 1.5 s anyway
POSITION_TIME_S: Final = 0.7
VELOCITY_NOISE_M_S: Final = 0.5  # an error that is this many times larger is followed as many times faster,
POSITION_NOISE_M: Final = 0.6
MAX_SPEED_UP: Final = 3.0  # but no more than this
# m/s^2, that is fed forward, and by which velocities change beside it: more is seldom true. A leader that yaws on
# the spot looks for a second as if it flew off with 15 m/s^2.
MAX_LEADER_ACCELERATION: Final = 3.0
MIN_COURSE_SPEED: Final = 1.0  # m/s; a slower leader drifts, and its velocity has no meaning for its course
MIN_COURSE_SIGMAS: Final = 2.5  # from a standstill; velocities of hovering leaders are estimated up to here,
FULL_COURSE_SIGMAS: Final = 4.0  # and never beyond here
# Beside a leader its range, and so its course, stays open for as long as we fly parallel: going round shows it.
UNSURE_CERTAINTY, UNSURE_SPEED_M_S = 0.1, 2.0
COURSE_LEARNING_S: Final = 1.0  # of sure flight: errors of velocity last for most of a second
SAME_WAY_ANGLE: Final = 2.6  # rad; beyond, both ways round are as long: go on turning as before
MIN_TURN_RATE: Final = 0.05  # rad/s, that counts as a way round
CLIMB_TIME_S: Final = 1.0  # in which the climb of an unseen leader ends


class LeaderTrack:
    """Motion of the leader in n: `r`, `v`, `a` (3,), `covariance` (6, 6) of position and velocity, and
    `range_covariance` (3, 3) of the vector from us. `course`: of its flight (rad), None before it has flown.
    `slot_course`: that the slot is behind, which turns as fast as the vehicle can fly it. `turn_rate` in rad/s."""

    def __init__(self) -> None:
        self.r, self.v, self.a = np.zeros(3), np.zeros(3), np.zeros(3)
        self.covariance, self.range_covariance = np.zeros((6, 6)), np.zeros((3, 3))
        self.v_seen = self.v  # not smoothed
        self.is_known = False
        self.course: float | None = None
        self.slot_course = 0.0
        self.turn_rate = 0.0
        self._flown_s = 0.0  # for how long it has surely flown
        self._way = 0.0  # the last rate of the slot's course

    def restart(self) -> None:
        """Take the next state as it is, since the leader was lost for long. The course stays."""
        self.is_known = False

    def resume(self, known: LeaderState, course: float | None) -> None:
        """Continue the leader of an earlier run."""
        self.restart()
        self.see(known, 0.0)
        self.turn_rate = turn_rate(self.v, self.a)
        if course is not None:
            self.course, self.slot_course, self._flown_s = course, course, COURSE_LEARNING_S

    def shift(self, step: Array) -> None:
        """Move the origin of n (3,): the autopilot's position was reset by `step`."""
        self.r = self.r + step

    def see(self, state: LeaderState, dt: float) -> None:
        """Follow a state at its time, `dt` s after the last step."""
        r, v, a = (np.array(x) for x in (state.r_OL_n, state.v_L_n, state.a_L_n))
        a = limited(a, MAX_LEADER_ACCELERATION)
        self.covariance, self.range_covariance = np.array(state.covariance), np.array(state.r_FL_covariance)
        self.v_seen = v
        if not self.is_known:
            self.r, self.v, self.a, self.is_known = r, v, a, True
            return
        self.a = self.a + -math.expm1(-dt / ACCELERATION_TIME_S) * (a - self.a)
        moved = self.v + dt * self.a
        change = _share(v - moved, dt / VELOCITY_TIME_S, VELOCITY_NOISE_M_S)
        self.v = moved + limited(change, MAX_LEADER_ACCELERATION * dt)
        moved = self.r + dt * self.v
        self.r = moved + _share(r - moved, dt / POSITION_TIME_S, POSITION_NOISE_M)

    def coast(self, dt: float) -> None:
        """Let the leader fly on in its turn; its climb ends."""
        self.r, self.v = carried(self.r, self.v, self.turn_rate, dt)
        self.v_seen = self.v
        self.v[2] *= math.exp(-dt / CLIMB_TIME_S)
        self.a = np.array([-self.turn_rate * self.v[1], self.turn_rate * self.v[0], 0.0])

    def turn(self, r_F: Array, max_rate: float, dt: float, *, is_seen: bool) -> float:
        """Turn the slot's course towards the leader's, at `max_rate` (rad/s) at most. Returns its rate."""
        certainty = self._certainty() if is_seen else 0.0
        if is_seen:
            rate = certainty * turn_rate(self.v, self.a)
            self.turn_rate += -math.expm1(-dt / ACCELERATION_TIME_S) * (rate - self.turn_rate)
        if self._flown_s < COURSE_LEARNING_S:
            self._flown_s = self._flown_s + dt * certainty if certainty > 0.0 else max(self._flown_s - dt, 0.0)
            self.slot_course = math.atan2(self.r[1] - r_F[1], self.r[0] - r_F[0])
            return 0.0
        flown = math.atan2(self.v[1], self.v[0])
        if certainty > 0.5:
            self.course = flown
        away = wrapped(flown - self.slot_course)
        if abs(away) > SAME_WAY_ANGLE and away * self._way < 0.0:
            away = -away
        rate = min(max(certainty * away + self.turn_rate, -max_rate), max_rate)
        if abs(rate) > MIN_TURN_RATE:
            self._way = rate
        self.slot_course = wrapped(self.slot_course + rate * dt)
        return rate

    def _certainty(self) -> float:
        """Between 0 and 1: how surely the leader flies on the course of its velocity."""
        v, P = self.v[:2], self.covariance[3:5, 3:5]
        speed = max(math.hypot(v[0], v[1]), 1e-6)
        sigma_across = sigma_along(P, np.array([-v[1], v[0]]) / speed)
        sigmas = math.sqrt(max(float(v @ np.linalg.lstsq(P, v, rcond=None)[0]), 0.0))
        by_speed = min(max(speed - max(MIN_COURSE_SPEED, 2.0 * sigma_across), 0.0), 1.0)
        by_sigmas = (sigmas - MIN_COURSE_SIGMAS) / (FULL_COURSE_SIGMAS - MIN_COURSE_SIGMAS)
        sure = by_speed * min(max(by_sigmas, 0.0), 1.0)
        return max(sure, UNSURE_CERTAINTY if speed > UNSURE_SPEED_M_S else 0.0)


def _share(error: Array, share: float, noise: float) -> Array:
    """The part of an error that one step takes away: more of what is too large for noise."""
    speed_up = min(max(float(np.linalg.norm(error)) / noise, 1.0), MAX_SPEED_UP)
    return -math.expm1(-share * speed_up) * error


def wrapped(angle: float) -> float:
    """An angle in [-pi, pi], rad."""
    return math.remainder(angle, 2.0 * math.pi)


def limited(v: Array, max_length: float) -> Array:
    """A vector, shortened to `max_length` if it is longer."""
    length = float(np.linalg.norm(v))
    return v if length <= max_length else v * (max_length / length)


def sigma_along(P: Array, unit: Array) -> float:
    """The standard deviation of covariance P along a unit vector."""
    return math.sqrt(max(float(unit @ P @ unit), 0.0))
