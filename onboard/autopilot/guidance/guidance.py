"""The leader from tick to tick: where the slot behind it is, and how near and how far the vehicle may be led.

Common to all autopilots. What is remembered beyond smooth filters is in `states`. A `Follower` knows what its
autopilot makes of a target.
"""

import math
from typing import Final

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.autopilot.framing import Framing
from onboard.autopilot.guidance.ardupilot import ArduPilot
from onboard.autopilot.guidance.course import SLOW, Course, wrapped
from onboard.autopilot.guidance.follower import INSIDE, NEAR_SIGMAS, Follower
from onboard.autopilot.guidance.motion import (
    Sent,
    Slot,
    SmoothedLeader,
    flown_on,
    sigma_along,
    smoothed,
    turned,
)
from onboard.autopilot.guidance.states import GRACE_S, LOSING, PHASES, Activity, Event, Machine, Phase
from onboard.config import GuidanceConfig
from onboard.geometry.camera import Camera
from onboard.geometry.carried import turn_rate
from onboard.messages import Heartbeat, LeaderState, Quaternion
from onboard.units import NS_PER_S

LONGEST_STEP: Final = 0.1  # s
TURN_ACCELERATION: Final = 2.0  # m/s^2, of the slot about the leader
TURN_GAIN: Final = 0.8  # 1/s
FAR_OFF: Final = math.radians(45.0)  # from its slot about the leader: the follower goes round from where it is
# of the range, its standard deviation: above, the vehicle comes no nearer than the near end
UNSURE, SURE = 0.3, 0.25
MOST_STRETCH: Final = 1.5  # of the slot's distance
CUTS: Final = 0.9  # of it, to which the vehicle cuts the corner, half way round to a leader that flies at it
STRETCH_SPEED: Final = 2.0  # m/s
HARD_BRAKING: Final = 5.0  # m/s^2, of a follower whose leader is lost
LAST: Final = 0.3  # s
REMEMBERS_S, SILENCE_S = 10.0, 3.0  # s: of a run before; after which the autopilot stops by itself
OVERHEAD: Final = 2.0  # m; nearer in the plane, the leader has no bearing
IS_CLEAR: Final = 1.0  # m, from the height that it is led to

RANGE_UNSURE: Final = "range unsure: FOLLOW comes no nearer"


class Guidance:
    """State from tick to tick. `course`: the leader's, once learnt; that alone, if it `leads` nobody. `phase`:
    what the vehicle is led to do. `is_unsure`: the range is too uncertain to come nearer."""

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
        self.is_entered: bool | None = None  # the autopilot is in its mode; None: not known
        self._slot = np.array(config.slot_m)
        self._distance = float(np.linalg.norm(self._slot))
        least = config.least_distance_m
        self._least = 0.5 * self._distance if least is None else min(least, self._distance)
        self.restart()

    def restart(self) -> None:
        """Forget the leader, and that something was sent of it."""
        self._last: LeaderState | None = None
        self._phase = Machine(PHASES, Phase.UNLED)
        self._forget()

    def _forget(self) -> None:
        self.is_unsure = False
        self.follower.restart()
        self._t_ns = 0
        self._track: SmoothedLeader | None = None
        self._course = Course()
        self._direction = math.nan  # from the slot to the leader; NaN before there is one
        self._turn_rate = 0.0  # of the slot about the leader
        self._stretch = 1.0
        self._framing = Framing(self._config.slot_m)
        self._yaw: float | None = None
        self._valid_ns: int | None = None
        self._known: LeaderState | None = None  # of an earlier run, until it is used
        self._place: Array | None = None  # where the follower comes to rest, of this phase
        self._passes = ""

    def note_mode(self, heartbeat: Heartbeat) -> None:
        """Take the flight mode of a heartbeat."""
        self.is_entered = self.follower.is_entered(heartbeat)

    def note_parameter(self, name: str, value: float) -> None:
        """Take a parameter of the autopilot."""
        unit = self.follower.speed_parameters.get(name)
        if unit is not None and math.isfinite(value) and value > 0.0:
            self.follower.speed_m_s = value * unit

    def resume(self, known: LeaderState, course: float | None) -> None:
        """Go on with what an earlier run knew, which stands for a leader that was lost just now."""
        self._known = known
        if course is not None:
            self._course.resume(course, np.array(known.v_L_n))

    @property
    def phase(self) -> Phase:
        """What the vehicle is led to do."""
        return self._phase.state

    @property
    def warning(self) -> str:
        """Why the vehicle is not led as usual, in words; else ""."""
        return self._passes or (RANGE_UNSURE if self.is_unsure and self.is_entered else "")

    @property
    def course(self) -> float | None:
        """The leader's course, rad; None before it has flown."""
        return self._course.value if self._course.is_learnt else None

    def virtual_leader(
        self, state: LeaderState, r_F: Array, v_F: Array, q_nb: Quaternion | None = None
    ) -> LeaderState | None:
        """What to send at the state's time, from our own position and velocity in n and our attitude; None:
        nothing. It has no latitude or longitude. While the leader is lost the slot comes to rest, and the heading
        stays on where the leader should be, for `hold_s` and until the vehicle is off the leader's height."""
        dt = min(max((state.t_ns - self._t_ns) / NS_PER_S, 0.0), LONGEST_STEP)
        self._t_ns = state.t_ns
        has_place = bool(np.isfinite(r_F).all())
        if self._known is not None and has_place:
            self._begin_again(self._known, state.t_ns, r_F)
            self._track = None if state.valid else self._track
        seen = state if state.valid and has_place else None
        if seen is not None:
            self._see(seen, r_F, q_nb, dt)
        sent = self._step(seen, r_F, v_F, dt) if has_place else None
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

    def _lost_for(self) -> float:
        """Seconds since the leader was seen."""
        return math.inf if self._valid_ns is None else (self._t_ns - self._valid_ns) / NS_PER_S

    def _see(self, state: LeaderState, r_F: Array, q_nb: Quaternion | None, dt: float) -> None:
        """The smoothed leader, and its course. One that was lost for long is no step of the one before."""
        if self._lost_for() > GRACE_S:
            self._track = None
        self._valid_ns, self._last = state.t_ns, state
        if self._leads and q_nb is not None and self._camera is not None:
            self._framing.update(self._camera, q_nb, dt)
        r_L, v_L, P = np.array(state.r_OL_n), np.array(state.v_L_n), np.array(state.covariance)
        track = self._track = smoothed(self._track, r_L, v_L, np.array(state.a_L_n), dt)
        yaw = self._look(track, r_F)
        if self._course.value is None and self._config.start_course == "bearing":
            self._course.start(yaw)
        self._course.learn(track.v_observed, P[3:, 3:], dt)
        if self._course.value is None:
            return
        if not abs(wrapped(yaw - self._direction)) <= FAR_OFF:
            self._direction, self._turn_rate = yaw, 0.0
            if not self._course.is_learnt:
                self._course.start(yaw)
        self._turn(self._course.value, track, dt)
        length, sigma = self._range(state, r_F)
        self.is_unsure = sigma > UNSURE * max(length, self._least)
        self._widen(sigma / length, dt)

    @staticmethod
    def _range(state: LeaderState, r_F: Array) -> tuple[float, float]:
        """The range, and its standard deviation, m."""
        toward = np.array(state.r_OL_n) - r_F
        return max(float(np.linalg.norm(toward)), 1.0), sigma_along(np.array(state.r_FL_covariance), toward)

    def _step(self, seen: LeaderState | None, r_F: Array, v_F: Array, dt: float) -> Sent | None:
        """The next phase, and what it sends."""
        lost_for, begins = self._lost_for(), self.follower.begins is not None
        is_held = lost_for > self._config.hold_s
        self._passes = "" if seen is None else self._passing(seen, r_F, v_F)
        elsewhere = seen is None and self.is_entered is False and begins and self._last is not None
        lost = seen is None and not elsewhere
        clear = self._clear_height(r_F)
        events = {
            Event.SEEN: seen is not None and not self._passes,
            Event.PASSES: bool(self._passes),
            Event.LOST: lost,
            Event.ELSEWHERE: elsewhere,
            Event.HELD: lost and is_held,
            Event.CLEAR: lost and is_held and (clear is None or abs(clear - float(r_F[2])) < IS_CLEAR),
        }
        if self._phase.step(events, dt):
            self._place = None
        if seen is None and is_held and self.phase is not Phase.CLEARING and self._valid_ns is not None:
            self._forget()
        if self.phase is Phase.KEPT:
            return self._keep(r_F, v_F, dt)
        if seen is not None:
            return self._follow(seen, r_F, dt) if self._leads and self._course.value is not None else None
        return self._without(lost_for, r_F, v_F, clear, dt)

    def _passing(self, seen: LeaderState, r_F: Array, v_F: Array) -> str:
        """Whether the way passes the leader that the mode takes when it begins, in words. Once the vehicle is led
        in its mode, its way is the one that it is led."""
        is_led = self.is_entered and self.phase not in {Phase.UNLED, Phase.KEPT}
        if self.is_entered is None or is_led or not self._leads:
            return ""
        rests = self._course.motion.state is Activity.RESTS  # its velocity is noise, then
        v_L = np.zeros(3) if rests else np.array(seen.v_L_n)
        return self.follower.passes(r_F - np.array(seen.r_OL_n), v_F, v_L)

    def _follow(self, state: LeaderState, r_F: Array, dt: float) -> Sent:
        track, r_L, v_L = self._track, np.array(state.r_OL_n), np.array(state.v_L_n)
        assert track is not None  # noqa: S101 - `_see` has made it
        length, sigma = self._range(state, r_F)
        speed_sigma = sigma_along(np.array(state.covariance)[3:, 3:], r_L - r_F)
        slot = self._slot_at(self._look(track, r_F), length, sigma, speed_sigma)
        return self.follower.target(self.follower.follow(track, slot, r_L, v_L, r_F, dt), slot, dt)

    def _keep(self, r_F: Array, v_F: Array, dt: float) -> Sent:
        """What keeps a vehicle where it is that begins to follow. While somebody else flies it, its place goes
        along."""
        if not self.is_entered or (
            self._place is not None and math.dist(self._place, r_F) > self._config.closing_speed_m_s
        ):
            self._place = None
        if not self.is_entered:
            self.follower.restart()
        yaw = self.follower.begins or 0.0
        return self.follower.target(self._stand(r_F, v_F, yaw, brakes=True), self._slot_at(yaw), dt)

    def _slot_at(self, yaw: float, length: float = math.inf, sigma: float = 0.0, speed_sigma: float = 0.0) -> Slot:
        """Where the slot is, by now. `sigma`: of the range, which is estimated as `length`; `speed_sigma`: of the
        leader's speed along it.

        Where the range is unsure, the vehicle comes nearer for as long as the near end of the range is beyond the
        slot, and goes away from a leader only that is nearer than the slot as estimated."""
        arm = turned(self._stretch * self._slot, self._direction)
        arm[2] += self._framing.lift
        most, inside = MOST_STRETCH * self._distance, INSIDE * min(self._stretch, 1.0) * self._distance
        sure = min(max(self._least + NEAR_SIGMAS * sigma, inside), most)
        unsure = min(max((sigma / max(length, self._least) - SURE) / (UNSURE - SURE), 0.0), 1.0)
        nearer = length * -math.expm1(-NEAR_SIGMAS * sigma / length) if sigma > 0.0 else 0.0
        room = sure + unsure * (inside + nearer - sure)
        firm = sure + unsure * (inside - sure)
        entered = self.is_entered is not False
        flies = self._course.motion.state is not Activity.RESTS and (entered or self._is_fast())
        return Slot(arm, self._turn_rate, yaw, room, firm, most, nearer, speed_sigma, entered, flies)

    def _is_fast(self) -> bool:
        """The last target before the mode is entered is the one that it begins on: a leader that is slow rests."""
        return self._track is not None and math.hypot(*self._track.v_observed[:2]) > SLOW

    def _begin_again(self, known: LeaderState, t_ns: int, r_F: Array) -> None:
        """Suppose that a leader of a time before has flown on as it did, and is lost now. After a long silence the
        vehicle brakes already: then only its nose is led."""
        self._known = None
        age = (t_ns - known.t_ns) / NS_PER_S
        if not 0.0 <= age <= REMEMBERS_S:
            return
        v, a = np.array(known.v_L_n), np.array(known.a_L_n)
        self._turn_rate = turn_rate(v, a)
        self._track = flown_on(SmoothedLeader(np.array(known.r_OL_n), v, v, a), self._turn_rate, age)
        self._last = known
        is_late = age > SILENCE_S
        self._valid_ns = t_ns - (round(GRACE_S * NS_PER_S) if is_late else 0)
        if self.is_entered is not False:
            self._phase.enter(Phase.STOPPED if is_late else Phase.CARRIED)
        self._direction = self._look(self._track, r_F)

    def _without(self, t: float, r_F: Array, v_F: Array, clear: float | None, dt: float) -> Sent | None:
        """What to send `t` s after the leader was lost. It is supposed to fly on as it did, turns included; it is
        followed for a moment, since most drop-outs are short."""
        track, phase = self._track, self.phase
        if track is None or phase not in LOSING or phase is Phase.SILENT:
            return None
        track = self._track = flown_on(track, self._turn_rate, dt)
        yaw = self._look(track, r_F)
        slot = self._slot_at(yaw)
        if phase is Phase.CARRIED:
            self._direction = wrapped(self._direction + self._turn_rate * dt)
            slot = self._slot_at(yaw)
            return self.follower.target(self.follower.follow(track, slot, track.r, track.v, r_F, dt), slot, dt)
        # the last messages have no acceleration: the autopilot carries it on in the silence that follows
        sent = self._stand(r_F, v_F, yaw, brakes=t < self._config.hold_s - LAST)
        if phase is Phase.CLEARING and clear is not None:
            sent = sent._replace(r=np.array([sent.r[0], sent.r[1], clear]))
        return self.follower.target(sent, slot, dt)

    def _clear_height(self, r_F: Array) -> float | None:
        """The height, down in n, at which a vehicle is off the leader's that stands where the leader may come by:
        on the side of it where the vehicle is, above if there is no room below. None: it stays at its own."""
        by = self._config.clear_height_m
        if self._track is None or by == 0.0 or not self.follower.leads_round:
            return None
        above, below = float(self._track.r[2]) - by, float(self._track.r[2]) + by
        is_below = float(r_F[2] - self._track.r[2]) > 0.0 and below <= -by  # of the origin
        return max(below, float(r_F[2])) if is_below else min(above, float(r_F[2]))

    def _stand(self, r_F: Array, v_F: Array, yaw: float, *, brakes: bool) -> Sent:
        """Come to rest, and stay there."""
        if self._place is None:
            self._place = r_F + v_F * (float(np.linalg.norm(v_F)) / (2.0 * HARD_BRAKING))
        return self.follower.stop(self._place, v_F, yaw, brakes=brakes)

    def _look(self, track: SmoothedLeader, r_F: Array) -> float:
        """The direction from us to the leader, rad."""
        x, y, _ = (track.r - r_F).tolist()
        if self._yaw is None or math.hypot(x, y) > OVERHEAD:
            self._yaw = math.atan2(y, x)
        return self._yaw

    def _turn(self, course: float, track: SmoothedLeader, dt: float) -> None:
        """Turn the slot about the leader, towards its course, as fast as the vehicle can fly that."""
        arm = turned(self._stretch * self._slot, self._direction)
        change = TURN_ACCELERATION / max(math.hypot(arm[0], arm[1]), 1.0)
        least, most = self.follower.turn_limits(track.v_observed, arm)
        away = wrapped(course - self._direction)
        rate = math.copysign(min(TURN_GAIN * abs(away), math.sqrt(change * abs(away))), away)
        rate = min(max(rate + self._course.rate(track.v_observed, track.a), least), most)
        self._turn_rate += min(max(rate - self._turn_rate, -change * dt), change * dt)
        self._direction = wrapped(self._direction + self._turn_rate * dt)

    def _widen(self, relative_sigma: float, dt: float) -> None:
        """Let the slot's distance grow where the leader may be so near that it is too little. Let it shrink where
        the slot is far round a leader that flies on: cutting the corner is a shorter way, which turns faster."""
        room = self._distance * max(1.0 - NEAR_SIGMAS * relative_sigma, 0.01)
        wanted = min(max(self._least / room, 1.0), MOST_STRETCH)
        if self.follower.leads_round and self._course.value is not None:
            away = wrapped(self._course.value - self._direction)
            wanted *= 1.0 - (1.0 - CUTS) * math.sin(2.0 * min(abs(away), 0.5 * math.pi))
        step = STRETCH_SPEED / self._distance * dt
        self._stretch += min(max(wanted - self._stretch, -step), step)
