"""From the estimate of the leader to what an autopilot can fly: a slot that moves smoothly, keeps its distance
and turns at a bounded rate.

An autopilot in FOLLOW mode flies to the target that it is sent, plus an offset that turns with the target's
heading. It is sent a *virtual leader*, placed so that its offset ends in the slot that is meant here, with the
slot's velocity, and with the direction to the true leader as its heading. Where the slot is at rest behind the
leader, both coincide.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.autopilot.course import Course, wrapped
from onboard.autopilot.framing import Framing
from onboard.config import GuidanceConfig
from onboard.geometry.camera import Camera
from onboard.geometry.units import NS_PER_S
from onboard.messages import LeaderState, Quaternion

LONGEST_STEP: Final = 0.1  # s
ACCELERATION_RATE: Final = 5.0  # 1/s, with which the acceleration is smoothed
VELOCITY_RATE: Final = 1.2  # 1/s, with which the velocity is
POSITION_RATE: Final = 0.4  # rad/s, with which the position is
NOISE: Final = (0.4, 0.6)  # m/s, m: errors that are seldom noise raise the bandwidth
MOST_FASTER: Final = 4.0
LEAD: Final = 0.5  # s, by which ArduPilot's position control lags behind the velocity that it is sent
MOST_ACCELERATION: Final = 4.0  # m/s^2, of the smoothed leader
TURN_SPEED, TURN_ACCELERATION = 7.0, 2.0  # m/s, m/s^2: of the slot about the leader
TURN_GAIN: Final = 0.8  # 1/s
FAR_OFF: Final = math.radians(45.0)  # from its slot about the leader: the follower goes round from where it is
NEAR_SIGMAS: Final = 2.0  # the near end of the covariance
INSIDE: Final = 0.9  # of the slot's distance: nearer, the smoothed leader no longer decides
MOST_STRETCH: Final = 2.0  # of the slot's distance
BAND: Final = 0.08  # of the slot's distance
BAND_SPEED: Final = 1.0  # m/s, at which the band opens
HOVERS: Final = 1.0  # m/s
STRETCH_SPEED: Final = 2.0  # m/s
HARD_BRAKING, EXTRA_BRAKING = 5.0, 1.5  # m/s^2, of a follower whose leader is lost; beyond its own limit of 2.5
GRACE: Final = 1.0  # s, before it brakes
SLOW_ENOUGH, LAST = 2.0, 0.3  # m/s, s
CLOSES: Final = 0.5  # m/s, at which a slot at its distance closes on the leader, at most: noise
BRAKING: Final = 2.2  # m/s^2: less than ArduPilot's 2.5, so that it stops where it is meant to
REMEMBERS_S, SILENCE_S = 10.0, 3.0  # s: of a run before; after which FOLLOW brakes by itself
OVERHEAD: Final = 2.0  # m; nearer in the plane, the leader has no bearing


FORWARD: Final = np.array([1.0, 0.0, 0.0])


class Track(NamedTuple):
    """The smoothed leader: position and its derivative, and velocity and acceleration as observed (m, NED)."""

    r: Array
    v: Array
    v_observed: Array
    a: Array


class Sent(NamedTuple):
    """Position, velocity and acceleration of what is to be flown to, n, and the heading to have (rad). The
    acceleration is that of the turn and of braking only: an autopilot carries it on for as long as it waits for
    the next message."""

    r: Array
    v: Array
    a: Array
    yaw: float


class Guidance:
    """State from tick to tick. `course`: the leader's, once learnt."""

    def __init__(self, config: GuidanceConfig, camera: Camera | None = None) -> None:
        self._config, self._camera = config, camera
        self._slot = np.array(config.slot_m)
        self._distance = float(np.linalg.norm(self._slot))
        least = config.least_distance_m
        self._least = 0.5 * self._distance if least is None else min(least, self._distance)
        self.restart()

    def restart(self) -> None:
        """Forget the leader."""
        self._t_ns = 0
        self._track: Track | None = None
        self._course = Course()
        self._direction = math.nan  # from the slot to the leader; NaN before there is one
        self._turn_rate = 0.0  # of the slot about the leader
        self._stretch = 1.0
        self._framing = Framing(self._config.slot_m)
        self._band = 0.0  # m
        self._held: Array | None = None  # where the slot stands
        self._yaw: float | None = None
        self._valid_ns: int | None = None
        self._last: LeaderState | None = None
        self._known: LeaderState | None = None  # of an earlier run, until it is used
        self._stop: Array | None = None  # where the follower comes to rest once the leader is lost

    def resume(self, known: LeaderState, course: float | None) -> None:
        """Go on with what an earlier run knew, which stands for a leader that was lost just now."""
        self._known = known
        if course is not None:
            self._course.resume(course)

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
        if self._known is not None and not state.valid and np.isfinite(r_F).all():
            self._begin_again(self._known, state.t_ns, r_F)
        if state.valid:
            self._valid_ns, self._stop = state.t_ns, None
            self._last, self._known = state, None
            if q_nb is not None and self._camera is not None:
                self._framing.update(self._camera, q_nb, dt)
            sent = self._follow(state, r_F, dt)
        elif self._valid_ns is None:
            return None
        elif state.t_ns - self._valid_ns > self._config.hold_s * NS_PER_S:
            self.restart()
            return None
        else:
            sent = self._hold((state.t_ns - self._valid_ns) / NS_PER_S, r_F, v_F, dt)
        if sent is None or self._last is None:
            return None
        r = sent.r - turned(self._slot, sent.yaw)
        return replace(
            self._last,
            t_ns=state.t_ns,
            t_host_ns=state.t_host_ns,
            r_OL_n=tuple(r.tolist()),
            v_L_n=tuple(sent.v.tolist()),
            a_L_n=tuple(sent.a.tolist()),
            course=sent.yaw,
            lat_deg=None,
            lon_deg=None,
            alt_msl=None,
        )

    def _follow(self, state: LeaderState, r_F: Array, dt: float) -> Sent | None:
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
        toward = r_L - r_F
        sigma = _sigma(np.array(state.r_FL_covariance), toward)
        self._widen(sigma / max(float(np.linalg.norm(toward)), 1.0), dt)
        return self._kept_away(self._slot_of(track, r_F, yaw, dt), track, r_L, v_L, sigma)

    def _slot_of(self, track: Track, r_F: Array, yaw: float, dt: float) -> Sent:
        """The slot's motion, and as much of its place as may be flown to at once."""
        arm = turned(self._stretch * self._slot, self._direction)
        arm[2] += self._framing.lift
        turn = self._turn_rate
        v = track.v + turn * _across(arm)
        a = turn * _across(v)
        change = track.a - turn * _across(track.v)
        ahead = turned(FORWARD, yaw)
        a = a + min(float(change @ ahead), 0.0) * ahead
        r, v = self._at_rest(track.r + arm, v + LEAD * change, float(np.linalg.norm(track.v)), dt)
        error = r - r_F
        length = float(np.linalg.norm(error))
        if length > self._config.closing_speed_m_s:  # position control closes at about 1/s
            r = r_F + error * (self._config.closing_speed_m_s / length)
        return Sent(r, v, a, yaw)

    def _begin_again(self, known: LeaderState, t_ns: int, r_F: Array) -> None:
        """Suppose that a leader of a time before has flown on as it did, and is lost now. After a long silence the
        vehicle brakes already: then only its nose is led."""
        self._known = None
        age = (t_ns - known.t_ns) / NS_PER_S
        if not 0.0 <= age <= REMEMBERS_S:
            return
        v, a = np.array(known.v_L_n), np.array(known.a_L_n)
        self._turn_rate = self._course.rate_of(v, a)
        self._track = Track(np.array(known.r_OL_n), v, v, a)
        steps = math.ceil(age / LONGEST_STEP)
        for _ in range(steps):
            self._track = self._flown_on(self._track, age / steps)
        self._last = known
        self._valid_ns = t_ns - (round(GRACE * NS_PER_S) if age > SILENCE_S else 0)
        self._direction = self._look(self._track, r_F)

    def _flown_on(self, track: Track, dt: float) -> Track:
        """The leader `dt` s later, if it flies on as it did, turns included."""
        v = track.v + dt * self._turn_rate * _across(track.v)
        return track._replace(r=track.r + dt * v, v=v, a=self._turn_rate * _across(v))

    def _hold(self, t: float, r_F: Array, v_F: Array, dt: float) -> Sent | None:
        """What to send `t` s after the end of `valid`. The leader is supposed to fly on as it did, turns included;
        it is followed for a moment, since most drop-outs are short."""
        track = self._track
        if track is None or not np.isfinite(r_F).all():
            return None
        track = self._track = self._flown_on(track, dt)
        yaw = self._look(track, r_F)
        if t < GRACE:
            self._direction = wrapped(self._direction + self._turn_rate * dt)
            return self._slot_of(track, r_F, yaw, dt)
        speed = float(np.linalg.norm(v_F))
        if self._stop is None:
            self._stop = r_F + v_F * (speed / (2.0 * HARD_BRAKING))
        # the last messages have no acceleration, which the autopilot would carry on in the silence that follows
        brakes = speed > SLOW_ENOUGH and t < self._config.hold_s - LAST
        a = v_F * (-EXTRA_BRAKING / speed) if brakes else np.zeros(3)
        return Sent(self._stop, np.zeros(3), a, yaw)

    def _look(self, track: Track, r_F: Array) -> float:
        """The direction from us to the leader, rad."""
        x, y, _ = (track.r - r_F).tolist()
        if self._yaw is None or math.hypot(x, y) > OVERHEAD:
            self._yaw = math.atan2(y, x)
        return self._yaw

    def _turn(self, course: float, track: Track, dt: float) -> None:
        """Turn the slot about the leader, towards its course."""
        reach = max(math.hypot(self._slot[0], self._slot[1]), 1.0)
        most, change = TURN_SPEED / reach, TURN_ACCELERATION / reach
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

    def _kept_away(self, sent: Sent, track: Track, r_L: Array, v_L: Array, sigma: float) -> Sent:
        """Never nearer than the least distance from the near end of the covariance, and never closing faster than
        can be stopped before it. The smoothed leader lags behind one that brakes: a slot at its distance does not
        close on the velocity as observed, either."""
        away = r_L - sent.r
        distance = float(np.linalg.norm(away))
        if distance < 1e-3:
            return sent._replace(r=r_L - self._least * turned(FORWARD, sent.yaw), v=v_L)
        toward = away / distance
        room = max(self._least + NEAR_SIGMAS * sigma, INSIDE * self._distance)
        spare, beyond = distance - room, distance - self._distance
        fastest = self._config.closing_speed_m_s
        most = min(fastest, math.sqrt(2.0 * BRAKING * max(spare, 0.0)))
        most_observed = min(fastest, CLOSES + math.sqrt(2.0 * BRAKING * max(beyond, 0.0)))
        excess = float((sent.v - v_L) @ toward) - most
        excess = max(excess, float((sent.v - track.v_observed) @ toward) - most_observed, 0.0)
        r = sent.r + min(spare, 0.0) * toward
        return sent._replace(r=r, v=sent.v - excess * toward)


def smoothed(track: Track | None, r: Array, v: Array, a_L: Array, dt: float) -> Track:
    """The smoothed leader after `dt` s, when it is estimated at r, with v and a_L. Velocity and acceleration are
    smoothed first; then position and its derivative follow them, as one trajectory. What is too large for noise is
    followed faster."""
    if track is None:
        return Track(r, v, v, a_L)
    away, behind = v - track.v_observed, r - (track.r + dt * track.v)
    a = track.a + min(dt * ACCELERATION_RATE, 1.0) * (_limited(a_L, MOST_ACCELERATION) - track.a)
    v_observed = track.v_observed + dt * (a + VELOCITY_RATE * _faster(away, NOISE[0]) * away)
    rate = POSITION_RATE * _faster(behind, NOISE[1])
    pull = 2.0 * rate * (v_observed - track.v) + rate**2 * behind
    v_next = track.v + dt * _limited(a + pull, 2.0 * MOST_ACCELERATION)
    return Track(track.r + dt * v_next, v_next, v_observed, a)


def _faster(error: Array, noise: float) -> float:
    return min(max(float(np.linalg.norm(error)) / noise, 1.0), MOST_FASTER)


def _across(v: Array) -> Array:
    """A horizontal vector turned by 90 degrees to the right."""
    return np.array([-v[1], v[0], 0.0])


def turned(v: Array, yaw: float) -> Array:
    """A vector forward, right, down of a heading, in n."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


def _sigma(P: Array, direction: Array) -> float:
    """The standard deviation along a direction."""
    length = float(np.linalg.norm(direction))
    if length < 1e-3:
        return math.sqrt(float(np.linalg.eigvalsh(P)[-1]))
    u = direction / length
    return math.sqrt(max(float(u @ P @ u), 0.0))


def _limited(v: Array, most: float) -> Array:
    size = float(np.linalg.norm(v))
    return v if size <= most else v * (most / size)
