"""The leader as guidance follows it: smoothed motion, and the course of the slot.

There is no decision between manoeuvres: the slot's course follows the velocity by a weight between 0 and 1, how
surely the leader flies. Thus a leader that turns takes the slot along, one that stops leaves it in place, and one
that flies back turns it round while the vehicle goes round.
"""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.geometry.carried import carried, turn_rate
from onboard.messages import LeaderState

# Time constants of the smoothed motion. Estimates come 10 to 30 times a second, and position and velocity control
# of autopilots lag by 0.5 to 1.5 s anyway.
ACCELERATION_TIME_S: Final = 0.4
VELOCITY_TIME_S: Final = 0.5
POSITION_TIME_S: Final = 0.7
# An error n times the noise is corrected up to n times as fast.
VELOCITY_NOISE_M_S: Final = 0.5
POSITION_NOISE_M: Final = 0.6
MAX_CORRECTION_FACTOR: Final = 3.0
# A leader that yaws on the spot looks for a second as if it flew off with 15 m/s^2.
MAX_LEADER_ACCELERATION_M_S2: Final = 3.0
MIN_COURSE_SPEED_M_S: Final = 1.0  # a slower leader drifts, in any direction
# Velocity over its sigma. Hovering leaders are estimated to move by 2.5 sigmas at times, but never by 4.
MIN_COURSE_SIGMAS: Final = 2.5
FULL_COURSE_SIGMAS: Final = 4.0
# The range, and so the course, of a leader seen from its side is uncertain until the vehicle goes round it.
UNSURE_COURSE_WEIGHT: Final = 0.1
MIN_UNSURE_COURSE_SPEED_M_S: Final = 2.0
COURSE_LEARNING_TIME_S: Final = 1.0  # errors of velocity last for most of a second
MAX_SHORTER_WAY_ANGLE: Final = 2.6  # rad; beyond it both ways round are about as long: keep the direction
MIN_TURN_RATE: Final = 0.05  # rad/s; slower is no direction round the leader
CLIMB_DECAY_TIME_S: Final = 1.0  # of a leader that is not seen


class LeaderTrack:
    """Smoothed motion of the leader in n, and the course of the slot."""

    def __init__(self) -> None:
        self.r, self.v, self.a = np.zeros(3), np.zeros(3), np.zeros(3)
        self.covariance = np.zeros((6, 6))  # of position and velocity
        self.range_covariance = np.zeros((3, 3))  # of the vector from us to the leader
        self.v_estimated = self.v  # before smoothing
        self.is_known = False
        self.course: float | None = None  # rad; None before the leader has flown
        self.slot_course = 0.0  # rad; turns no faster than the vehicle can fly
        self.turn_rate = 0.0  # rad/s
        self._flight_time_s = 0.0
        self._last_rate = 0.0  # of the slot's course, rad/s

    def restart(self) -> None:
        """Take the next state as it is, without smoothing. The course stays."""
        self.is_known = False

    def resume(self, known: LeaderState, course: float | None) -> None:
        """Continue the leader of an earlier run."""
        self.restart()
        self.update(known, 0.0)
        self.turn_rate = turn_rate(self.v, self.a)
        if course is not None:
            self.course, self.slot_course, self._flight_time_s = course, course, COURSE_LEARNING_TIME_S

    def shift(self, step: Array) -> None:
        """Move the leader by `step` (3,): a reset has moved the origin of n."""
        self.r = self.r + step

    def update(self, state: LeaderState, dt: float) -> None:
        """Smooth a state that is `dt` s later than the last."""
        r, v, a = (np.array(x) for x in (state.r_OL_n, state.v_L_n, state.a_L_n))
        a = limit_length(a, MAX_LEADER_ACCELERATION_M_S2)
        self.covariance, self.range_covariance = np.array(state.covariance), np.array(state.r_FL_covariance)
        self.v_estimated = v
        if not self.is_known:
            self.r, self.v, self.a, self.is_known = r, v, a, True
            return
        self.a = self.a + -math.expm1(-dt / ACCELERATION_TIME_S) * (a - self.a)
        predicted = self.v + dt * self.a
        change = _correction(v - predicted, dt / VELOCITY_TIME_S, VELOCITY_NOISE_M_S)
        self.v = predicted + limit_length(change, MAX_LEADER_ACCELERATION_M_S2 * dt)
        predicted = self.r + dt * self.v
        self.r = predicted + _correction(r - predicted, dt / POSITION_TIME_S, POSITION_NOISE_M)

    def coast(self, dt: float) -> None:
        """Predict an unseen leader: speed and turn rate stay, and its climb decays."""
        self.r, self.v = carried(self.r, self.v, self.turn_rate, dt)
        self.v_estimated = self.v
        self.v[2] *= math.exp(-dt / CLIMB_DECAY_TIME_S)
        self.a = np.array([-self.turn_rate * self.v[1], self.turn_rate * self.v[0], 0.0])

    def turn_slot(self, r_F: Array, max_rate: float, dt: float, *, is_seen: bool) -> float:
        """Turn the slot's course towards the leader's. Returns its rate, up to `max_rate`."""
        weight = self._course_weight() if is_seen else 0.0
        if is_seen:
            rate = weight * turn_rate(self.v, self.a)
            self.turn_rate += -math.expm1(-dt / ACCELERATION_TIME_S) * (rate - self.turn_rate)
        if self._flight_time_s < COURSE_LEARNING_TIME_S:
            change = dt * weight if weight > 0.0 else -dt
            self._flight_time_s = max(self._flight_time_s + change, 0.0)
            self.slot_course = math.atan2(self.r[1] - r_F[1], self.r[0] - r_F[0])
            return 0.0
        course = math.atan2(self.v[1], self.v[0])
        if weight > 0.5:
            self.course = course
        angle = wrap_angle(course - self.slot_course)
        if abs(angle) > MAX_SHORTER_WAY_ANGLE and angle * self._last_rate < 0.0:
            angle = -angle
        rate = min(max(weight * angle + self.turn_rate, -max_rate), max_rate)
        if abs(rate) > MIN_TURN_RATE:
            self._last_rate = rate
        self.slot_course = wrap_angle(self.slot_course + rate * dt)
        return rate

    def _course_weight(self) -> float:
        """Weight between 0 and 1 of the velocity's course: how surely the leader flies on it."""
        v, P = self.v[:2], self.covariance[3:5, 3:5]
        speed = max(math.hypot(v[0], v[1]), 1e-6)
        sigma_across = sigma_along(P, np.array([-v[1], v[0]]) / speed)
        sigmas = math.sqrt(max(float(v @ np.linalg.lstsq(P, v, rcond=None)[0]), 0.0))
        by_speed = min(max(speed - max(MIN_COURSE_SPEED_M_S, 2.0 * sigma_across), 0.0), 1.0)
        by_sigmas = (sigmas - MIN_COURSE_SIGMAS) / (FULL_COURSE_SIGMAS - MIN_COURSE_SIGMAS)
        weight = by_speed * min(max(by_sigmas, 0.0), 1.0)
        return max(weight, UNSURE_COURSE_WEIGHT if speed > MIN_UNSURE_COURSE_SPEED_M_S else 0.0)


def _correction(error: Array, time_ratio: float, noise: float) -> Array:
    """Correction of an error within `time_ratio` time constants, faster beyond the noise."""
    factor = min(max(float(np.linalg.norm(error)) / noise, 1.0), MAX_CORRECTION_FACTOR)
    return -math.expm1(-time_ratio * factor) * error


def wrap_angle(angle: float) -> float:
    """Wrap an angle (rad) to [-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)


def limit_length(v: Array, max_length: float) -> Array:
    """Shorten a vector to `max_length` if it is longer."""
    length = float(np.linalg.norm(v))
    return v if length <= max_length else v * (max_length / length)


def sigma_along(P: Array, unit: Array) -> float:
    """Standard deviation of covariance P along a unit vector."""
    return math.sqrt(max(float(unit @ P @ unit), 0.0))
