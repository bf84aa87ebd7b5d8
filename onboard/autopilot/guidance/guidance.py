"""The leader's life from tick to tick: followed; waited for, where its range is not sure; lost.

Common to all autopilots: where the slot is, and how near and how far the vehicle may be led. A `Follower` knows
what its autopilot makes of a target.
"""

import math
from typing import Final

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.autopilot.course import Course, wrapped
from onboard.autopilot.framing import Framing
from onboard.autopilot.guidance.ardupilot import ArduPilot
from onboard.autopilot.guidance.follower import INSIDE, Follower
from onboard.autopilot.guidance.motion import (
    Sent,
    Slot,
    Track,
    flown_on,
    sigma_along,
    smoothed,
    turned,
)
from onboard.config import GuidanceConfig
from onboard.geometry.camera import Camera
from onboard.geometry.units import NS_PER_S
from onboard.messages import Heartbeat, LeaderState, Quaternion

LONGEST_STEP: Final = 0.1  # s
TURN_ACCELERATION: Final = 2.0  # m/s^2, of the slot about the leader
TURN_GAIN: Final = 0.8  # 1/s
FAR_OFF: Final = math.radians(45.0)  # from its slot about the leader: the follower goes round from where it is
NEAR_SIGMAS: Final = 2.0  # the near end of the covariance
UNSURE, SURE = 0.3, 0.25  # of the range, its standard deviation: above, it is waited for; below, followed again
MOST_NEARER: Final = 2.0  # m/s, by which the leader may come at us faster than it is estimated to
MOST_STRETCH: Final = 1.5  # of the slot's distance
STRETCH_SPEED: Final = 2.0  # m/s
HARD_BRAKING: Final = 5.0  # m/s^2, of a follower whose leader is lost
GRACE: Final = 1.0  # s, before it brakes
LAST: Final = 0.3  # s
REMEMBERS_S, SILENCE_S = 10.0, 3.0  # s: of a run before; after which the autopilot stops by itself
COMES: Final = 1.0  # m/s, of a leader that comes to us: nobody stays and looks
OVERHEAD: Final = 2.0  # m; nearer in the plane, the leader has no bearing

RANGE_UNSURE: Final = "range unsure: FOLLOW stays and looks"


class Guidance:
    """State from tick to tick. `course`: the leader's, once learnt; that alone, if it `leads` nobody. `is_unsure`:
    the range is too uncertain to be flown on. `is_waiting`: so the vehicle is led to stay where it is, with its
    nose on the leader."""

    def __init__(
        self,
        config: GuidanceConfig,
        camera: Camera | None = None,
        follower: Follower | None = None,
        *,
        leads: bool = True,
    ) -> None:
        self._config, self._camera, self._leads = config, camera, leads
        self.follower: Follower = follower or ArduPilot(config)
        self._follows: bool | None = None  # the autopilot is in its mode; None: not known
        self._is_led = False  # in it, or before it was entered
        self._slot = np.array(config.slot_m)
        self._distance = float(np.linalg.norm(self._slot))
        least = config.least_distance_m
        self._least = 0.5 * self._distance if least is None else min(least, self._distance)
        self.restart()

    def restart(self) -> None:
        """Forget the leader, and that something was sent of it."""
        self._last: LeaderState | None = None
        self._forget()

    def _forget(self) -> None:
        self.is_unsure = self.is_waiting = False
        self.follower.restart()
        self._t_ns = 0
        self._track: Track | None = None
        self._course = Course()
        self._direction = math.nan  # from the slot to the leader; NaN before there is one
        self._turn_rate = 0.0  # of the slot about the leader
        self._stretch = 1.0
        self._framing = Framing(self._config.slot_m)
        self._yaw: float | None = None
        self._valid_ns: int | None = None
        self._known: LeaderState | None = None  # of an earlier run, until it is used
        self._stop: Array | None = None  # where the follower comes to rest
        self._passes = ""

    def note_mode(self, heartbeat: Heartbeat) -> None:
        """Take the flight mode of a heartbeat."""
        self._follows = self.follower.is_entered(heartbeat)

    def _may_begin(self, state: LeaderState, r_F: Array, v_F: Array) -> bool:
        """Whether it may be led to the leader. Where the mode's own way would pass the leader it may not, until
        the vehicle is elsewhere; once it is led in its mode, its way is the one that it is led."""
        if self._follows is None or (self._follows and self._is_led):
            return True
        self._passes = self.follower.passes(r_F - np.array(state.r_OL_n), v_F, np.array(state.v_L_n))
        self._is_led = not self._passes
        return self._is_led

    def resume(self, known: LeaderState, course: float | None) -> None:
        """Go on with what an earlier run knew, which stands for a leader that was lost just now."""
        self._known = known
        if course is not None:
            self._course.resume(course)

    @property
    def warning(self) -> str:
        """Why the vehicle is not led as usual, in words; else ""."""
        return self._passes or (RANGE_UNSURE if self.is_waiting else "")

    @property
    def course(self) -> float | None:
        """The leader's course, rad; None before it has flown."""
        return self._course.value if self._course.is_learnt else None

    def virtual_leader(
        self, state: LeaderState, r_F: Array, v_F: Array, q_nb: Quaternion | None = None
    ) -> LeaderState | None:
        """What to send at the state's time, from our own position and velocity in n and our attitude; None:
        nothing. It has no latitude or longitude. While the leader is lost the slot comes to rest, and the heading
        stays on where the leader should be, for `hold_s`."""
        dt = min(max((state.t_ns - self._t_ns) / NS_PER_S, 0.0), LONGEST_STEP)
        self._t_ns = state.t_ns
        self._passes = ""
        if self._known is not None and np.isfinite(r_F).all():
            self._begin_again(self._known, state.t_ns, r_F)
            self._track = None if state.valid else self._track
        if state.valid and np.isfinite(r_F).all():
            self._valid_ns = state.t_ns
            self._last = state
            if self._leads and q_nb is not None and self._camera is not None:
                self._framing.update(self._camera, q_nb, dt)
            sent = self._follow(state, r_F, v_F, dt)
        else:
            sent = self._without(state.t_ns, r_F, v_F, dt)
        if sent is None or self._last is None or not self._leads:
            return None
        return replace(
            self._last,
            t_ns=state.t_ns,
            t_host_ns=state.t_host_ns,
            r_OL_n=tuple(sent.r.tolist()),
            v_L_n=tuple(sent.v.tolist()),
            a_L_n=tuple(sent.a.tolist()),
            course=sent.yaw,
            lat_deg=None,
            lon_deg=None,
            alt_msl=None,
        )

    def _follow(self, state: LeaderState, r_F: Array, v_F: Array, dt: float) -> Sent | None:
        r_L, v_L, P = np.array(state.r_OL_n), np.array(state.v_L_n), np.array(state.covariance)
        track = self._track = smoothed(self._track, r_L, v_L, np.array(state.a_L_n), dt)
        yaw = self._look(track, r_F)
        if self._course.value is None and self._config.start_course == "bearing":
            self._course.start(yaw)
        self._course.learn(track.v_observed, math.sqrt(max(P[3, 3], P[4, 4])), dt)
        if self._course.value is None:
            return None
        if not abs(wrapped(yaw - self._direction)) <= FAR_OFF:
            self._direction, self._turn_rate = yaw, 0.0
            if not self._course.is_learnt:
                self._course.start(yaw)
        self._turn(self._course.value, track, dt)
        if not self._leads:
            return None
        toward = r_L - r_F
        length = max(float(np.linalg.norm(toward)), 1.0)
        sigma = sigma_along(np.array(state.r_FL_covariance), toward)
        self.is_unsure = sigma > (SURE if self.is_unsure else UNSURE) * max(length, self._least)
        self._widen(sigma / length, dt)
        slot = self._slot_at(yaw, sigma)
        waits = self.follower.waits(track, sigma_along(P[3:, 3:], track.v), dt)
        closing, closing_sigma = -float(v_L @ toward) / length, sigma_along(P[3:, 3:], toward)
        comes = closing > max(COMES, NEAR_SIGMAS * closing_sigma)
        # what is unsure may be far off by a factor, not by a distance: beyond all slots it may be flown to
        may_be_near = length * math.exp(-NEAR_SIGMAS * sigma / length) < slot.most
        self.is_waiting = self.is_unsure and waits and may_be_near and not comes
        if not self._may_begin(state, r_F, v_F):
            return self._stay(r_F, v_F, slot, dt)
        if self.is_waiting:
            return self.follower.target(self._stand(r_F, v_F, yaw, brakes=True), slot, dt)
        self._stop = None
        nearer = min(NEAR_SIGMAS * closing_sigma, MOST_NEARER)
        sent = self.follower.follow(track, slot, r_L, v_L - toward * (nearer / length), r_F, dt)
        return self.follower.target(sent, slot, dt)

    def _stay(self, r_F: Array, v_F: Array, slot: Slot, dt: float) -> Sent | None:
        """What keeps a vehicle where it is that begins to follow; None: nothing is needed."""
        if self.follower.begins is None:
            return None
        if not self._follows:  # somebody else flies it: its own place goes along
            self._stop = None
            self.follower.restart()
        return self.follower.target(self._stand(r_F, v_F, self.follower.begins, brakes=True), slot, dt)

    def _slot_at(self, yaw: float, sigma: float = 0.0) -> Slot:
        """Where the slot is, by now. `sigma`: of the range."""
        arm = turned(self._stretch * self._slot, self._direction)
        arm[2] += self._framing.lift
        most = MOST_STRETCH * self._distance
        room = max(self._least + NEAR_SIGMAS * sigma, INSIDE * self._distance)
        entered = self._follows is not False
        return Slot(arm, self._turn_rate, yaw, min(room, most), most, entered)

    def _begin_again(self, known: LeaderState, t_ns: int, r_F: Array) -> None:
        """Suppose that a leader of a time before has flown on as it did, and is lost now. After a long silence the
        vehicle brakes already: then only its nose is led."""
        self._known = None
        age = (t_ns - known.t_ns) / NS_PER_S
        if not 0.0 <= age <= REMEMBERS_S:
            return
        self._is_led = self._follows is not False
        v, a = np.array(known.v_L_n), np.array(known.a_L_n)
        self._turn_rate = self._course.rate_of(v, a)
        self._track = Track(np.array(known.r_OL_n), v, v, a)
        steps = math.ceil(age / LONGEST_STEP)
        for _ in range(steps):
            self._track = flown_on(self._track, self._turn_rate, age / steps)
        self._last = known
        self._valid_ns = t_ns - (round(GRACE * NS_PER_S) if age > SILENCE_S else 0)
        self._direction = self._look(self._track, r_F)

    def _without(self, t_ns: int, r_F: Array, v_F: Array, dt: float) -> Sent | None:
        """What to send while there is no leader."""
        lost = math.inf if self._valid_ns is None else (t_ns - self._valid_ns) / NS_PER_S
        if lost > self._config.hold_s and self._valid_ns is not None:
            self._forget()
        if self._follows is False and self.follower.begins is not None:
            self._is_led = False
            is_needed = self._last is not None and bool(np.isfinite(r_F).all())
            return self._stay(r_F, v_F, self._slot_at(0.0), dt) if is_needed else None
        is_free = self._leads and self._follows is not None and not self._is_led
        if lost > self._config.hold_s or is_free:
            return None
        return self._hold(lost, r_F, v_F, dt)

    def _hold(self, t: float, r_F: Array, v_F: Array, dt: float) -> Sent | None:
        """What to send `t` s after the end of `valid`. The leader is supposed to fly on as it did, turns included;
        it is followed for a moment, since most drop-outs are short."""
        track = self._track
        if track is None or not np.isfinite(r_F).all():
            return None
        track = self._track = flown_on(track, self._turn_rate, dt)
        yaw = self._look(track, r_F)
        if t < GRACE and not self.is_waiting:
            self._direction = wrapped(self._direction + self._turn_rate * dt)
            slot = self._slot_at(yaw)
            sent = self.follower.follow(track, slot, track.r, track.v, r_F, dt)
        else:
            # the last messages have no acceleration: the autopilot carries it on in the silence that follows
            slot = self._slot_at(yaw)
            sent = self._stand(r_F, v_F, yaw, brakes=t < self._config.hold_s - LAST)
        return self.follower.target(sent, slot, dt)

    def _stand(self, r_F: Array, v_F: Array, yaw: float, *, brakes: bool) -> Sent:
        """Come to rest, and stay there. Where somebody else flies the vehicle, the place goes along."""
        on = v_F * (float(np.linalg.norm(v_F)) / (2.0 * HARD_BRAKING))
        left = self._stop is not None and math.dist(self._stop, r_F + on) > self._config.closing_speed_m_s
        if self._stop is None or (left and self.is_waiting):
            self._stop = r_F + on
        return self.follower.stop(self._stop, v_F, yaw, brakes=brakes)

    def _look(self, track: Track, r_F: Array) -> float:
        """The direction from us to the leader, rad."""
        x, y, _ = (track.r - r_F).tolist()
        if self._yaw is None or math.hypot(x, y) > OVERHEAD:
            self._yaw = math.atan2(y, x)
        return self._yaw

    def _turn(self, course: float, track: Track, dt: float) -> None:
        """Turn the slot about the leader, towards its course."""
        reach = max(math.hypot(self._slot[0], self._slot[1]), 1.0)
        most, change = self.follower.turn_speed / reach, TURN_ACCELERATION / reach
        away = wrapped(course - self._direction)
        rate = math.copysign(min(TURN_GAIN * abs(away), math.sqrt(change * abs(away))), away)
        rate = min(max(rate + self._course.rate(track.v_observed, track.a), -most), most)
        self._turn_rate += min(max(rate - self._turn_rate, -change * dt), change * dt)
        self._direction = wrapped(self._direction + self._turn_rate * dt)

    def _widen(self, relative_sigma: float, dt: float) -> None:
        """Let the slot's distance grow, where the leader may be so near that it is too little."""
        room = self._distance * max(1.0 - NEAR_SIGMAS * relative_sigma, 0.01)
        wanted = min(max(self._least / room, 1.0), MOST_STRETCH)
        step = STRETCH_SPEED / self._distance * dt
        self._stretch += min(max(wanted - self._stretch, -step), step)
