"""ArduPilot's FOLLOW, read in the sources of 4.7-dev (`mode_follow.cpp`, `AP_Follow.cpp`).

It carries the target's position on with the velocity and the acceleration that are sent, adds `FOLL_OFS_*`, which
turn with the heading that is sent, and flies there with the target's velocity: a square-root controller on the
error of place, within `WPNAV_SPEED`, `WPNAV_ACCEL` and a limit of jerk. `WPNAV_SPEED` does not limit the velocity
that is sent. `FOLL_TIMEOUT`, 3 s, after the last target it brakes and holds its place.

So it is sent a *virtual leader*, placed so that its offset ends in the slot that is meant here, with the slot's
velocity, and with the direction to the true leader as its heading. Where the slot is at rest behind the leader,
both coincide.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.guidance.follower import NEAR_SHARE, NEAR_SIGMAS, NOISE, kept_away, stopping, surely_closing
from onboard.autopilot.guidance.motion import FORWARD, Sent, Slot, SmoothedLeader, across, limited, turned
from onboard.config import GuidanceConfig
from onboard.messages import Heartbeat

LEAD: Final = 0.5  # s, by which its position control lags behind the velocity that it is sent
BAND: Final = 0.08  # of the slot's distance
BAND_SPEED: Final = 1.0  # m/s, at which the band opens
HOVERS: Final = 1.0  # m/s
EXTRA_BRAKING: Final = 1.5  # m/s^2, beyond its own limit of 2.5
SLOW_ENOUGH: Final = 2.0  # m/s
LAG_S: Final = 0.8  # until a lean that speeds it up has become one that brakes
CLOSES: Final = 0.5  # m/s, at which a slot at its distance closes on the leader, at most: noise
SPEED_PARAMETERS: Final = {"WPNAV_SPEED": 0.01, "WP_SPD": 1.0}  # m/s of their unit; the second in newer ones
FOLLOW: Final = 23  # custom_mode of ArduCopter
COPTERS: Final = frozenset({2, 3, 4, 13, 14, 15, 29, 35})  # MAV_TYPE
MOST_NEARER: Final = 2.0  # m/s, by which the leader may come at us faster than estimated, or one sigma if more
SLOWEST_TURN: Final = 2.0  # m/s, about a leader that is as fast as the vehicle
ENTERS: Final = 2.0  # m/s^2, at which it begins to close up once FOLLOW is entered


class ArduPilot:
    """A virtual leader."""

    when_lost = "FOLLOW brakes within 3 s"
    begins: float | None = None
    leads_round = True
    speed_parameters: Mapping[str, float] = SPEED_PARAMETERS

    def __init__(self, config: GuidanceConfig) -> None:
        self._config, self._slot = config, np.array(config.slot_m)
        self._distance = float(np.linalg.norm(self._slot))
        self.speed_m_s = config.speed_m_s
        self.restart()

    def restart(self) -> None:
        """Forget the leader."""
        self._band = 0.0  # m
        self._held: Array | None = None  # where the slot stands
        self._reach = self._config.closing_speed_m_s  # m, to which it may be led at once

    def is_entered(self, heartbeat: Heartbeat) -> bool | None:
        """Whether it is in FOLLOW. Vehicles that are no copters have other numbers."""
        return heartbeat.custom_mode == FOLLOW if heartbeat.vehicle_type in COPTERS else None

    def turn_limits(self, v: Array, arm: Array) -> tuple[float, float]:
        """By the vehicle's own speed and lean. The slot has the leader's velocity and its own about the leader,
        and an acceleration of the rate times that."""
        reach = max(math.hypot(arm[0], arm[1]), 1.0)
        square, lean = float(v[0] * v[0] + v[1] * v[1]), self._config.acceleration_m_s2
        by_lean = math.sqrt(math.sqrt(square * square + (2.0 * reach * lean) ** 2) - square) / (
            reach * math.sqrt(2.0)
        )
        aside = float(v @ across(arm)) / reach
        most = min(self.speed_m_s, self._config.speed_m_s)
        spare = math.sqrt(max(most * most - square + aside * aside, SLOWEST_TURN**2))
        return max(-by_lean, (-aside - spare) / reach), min(by_lean, (-aside + spare) / reach)

    def follow(self, track: SmoothedLeader, slot: Slot, r_L: Array, v_L: Array, r_F: Array, dt: float) -> Sent:
        """The slot's motion, and as much of its place as may be flown to at once."""
        turn = slot.turn_rate
        v = track.v + turn * across(slot.arm)
        change = track.a - turn * across(track.v)
        ahead = turned(FORWARD, slot.yaw)
        a = turn * across(v) + min(float(change @ ahead), 0.0) * ahead
        r, v = self._at_rest(track.r + slot.arm, v + LEAD * change, float(np.linalg.norm(track.v)), dt)
        r = kept_away(r, r_L, r_F, ahead, slot)
        most = self._config.closing_speed_m_s
        self._reach = min(self._reach + ENTERS * dt, most) if slot.is_entered else 0.0
        # position control closes at about 1/s, so the step is the speed
        r = r_F + limited(r - r_F, self._reach)
        return Sent(r, self._braked(r, v, track, slot, r_L, v_L), a, slot.yaw)

    def stop(self, place: Array, v_F: Array, yaw: float, *, brakes: bool) -> Sent:
        """At a standstill from now on: it brakes as it can."""
        speed = float(np.linalg.norm(v_F))
        a = v_F * (-EXTRA_BRAKING / speed) if brakes and speed > SLOW_ENOUGH else np.zeros(3)
        return Sent(place, np.zeros(3), a, yaw, stands=True)

    def target(self, sent: Sent, slot: Slot, dt: float) -> Sent:  # noqa: ARG002 - it flies where it is led
        """Where its offset ends in the place."""
        return sent._replace(r=sent.r - turned(self._slot, sent.yaw))

    def passes(self, r: Array, v_F: Array, v_L: Array) -> str:  # noqa: ARG002 - it goes round as it is led
        """Nothing: it flies where it is led."""
        return ""

    def _at_rest(self, r: Array, v: Array, speed: float, dt: float) -> tuple[Array, Array]:
        """Behind a leader that hovers the slot stands still, until it is out by more than a band: in a hover the
        range wanders with the errors of the estimate."""
        most = BAND * self._distance
        step = BAND_SPEED * dt if speed < HOVERS else -2.0 * BAND_SPEED * dt
        self._band = min(max(self._band + step, 0.0), most)
        held = r if self._held is None else self._held
        away = held - r
        length = float(np.linalg.norm(away))
        is_inside = length < self._band
        self._held = held if is_inside else r + away * (self._band / length if length > 0.0 else 0.0)
        return self._held, v * (0.0 if is_inside else 1.0)

    def _braked(self, r: Array, v: Array, track: SmoothedLeader, slot: Slot, r_L: Array, v_L: Array) -> Array:
        """The velocity v at r, without what closes faster than can be stopped: before the room that the leader as
        estimated is left, and before two thirds of the slot's distance from the near end of where and how fast it
        may be. What is unsure makes nobody flee, though. The smoothed leader lags behind one that brakes: it
        closes up by its place, and not by a velocity beyond that observed. Nor does the distance grow faster than
        it may shrink, behind a leader that surely flies off. r is where the vehicle is led now: one that is far
        behind its slot flies as fast as the leader, however unsure that is."""
        away = r_L - r
        distance = float(np.linalg.norm(away))
        if distance < 1e-3:
            return v_L
        toward, fastest = away / distance, self._config.closing_speed_m_s
        recedes, observed = float(v_L @ toward), float(track.v_observed @ toward)
        slower = max(min(NEAR_SIGMAS * slot.speed_sigma, MOST_NEARER), slot.speed_sigma)
        most = recedes - slower + stopping(distance - slot.room)
        most = max(min(most, recedes + fastest), min(recedes, 0.0))
        most = min(most, surely_closing(r, r_L, v_L, slot, NEAR_SHARE * self._distance, LAG_S))
        most = min(most, observed + CLOSES)
        speed = float(v @ toward)
        surely = observed - max(NEAR_SIGMAS * slot.speed_sigma - NOISE, 0.0)
        return v + (max(min(speed, most), surely - fastest) - speed) * toward
