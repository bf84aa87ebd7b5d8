"""Who is led, and when: the follow law between the estimate of the leader and the autopilot's setpoint mode.

The pilot alone changes modes. The vehicle is led once its mode is entered in the air while guidance is ready, and
until the mode is left. In the mode the stream of setpoints never ends: its end is the autopilot's failsafe.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.autopilot.framing import Framing
from onboard.autopilot.guidance.autopilots import SetpointMode, limited_by
from onboard.autopilot.guidance.law import COAST_S, FollowLaw, Phase, ReferenceState
from onboard.autopilot.guidance.leader import LeaderTrack
from onboard.config import GuidanceConfig
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import CurrentMode, Heartbeat, LandedState, LeaderState, Message, ParamValue, Quaternion
from onboard.messages.causes import Cause
from onboard.units import NS_PER_S

MAX_STEP_S: Final = 0.1  # of the law; a longer pause is no step
MAX_POSITION_STEP_M: Final = 2.0  # of our own position beyond its velocity; more is a reset of the filter
MODE_WAIT_S: Final = 5.0  # for CURRENT_MODE, which PX4 has from 1.15 on, before a stream begins without it
REMEMBERED_S: Final = 10.0  # for which a leader is carried on without us; a warm start's state is not older


class Follower(NamedTuple):
    """Our own position and velocity (3,) in n, NaN where not known, and attitude."""

    r_F: Array
    v_F: Array
    q_nb: Quaternion | None


class Guidance:
    """State from tick to tick. `setpoint`: to send now, None for silence. `smoothed`: the leader as
    FOLLOW_TARGET has it, None without one. `is_on`: the autopilot is in its setpoint mode. `leads`: the vehicle
    is led. `parameter_texts`: what is wrong with parameters of the autopilot, until taken."""

    def __init__(
        self, config: GuidanceConfig, camera: Camera | None = None, mode: SetpointMode | None = None
    ) -> None:
        self._config, self._camera, self._mode = config, camera, mode
        self.parameter_texts: list[str] = []
        self.restart()

    def restart(self) -> None:
        """Forget the leader and the vehicle: its autopilot has rebooted."""
        self._law, self._leader = FollowLaw(self._config), LeaderTrack()
        self._framing = Framing(self._config.slot_m)
        self.setpoint: ReferenceState | None = None
        self.smoothed: LeaderState | None = None
        self.is_on = self.leads = False
        self._has_led = self._streams = self._is_on_ground = False
        self._is_first_mode = True
        self._intends_mode: bool | None = None
        self._t_ns: int | None = None
        self._waited_s = 0.0  # since the start
        self._seen_ns: int | None = None
        self._own: Follower | None = None

    @property
    def course(self) -> float | None:
        """The leader's course (rad), None before it has flown."""
        return self._leader.course

    @property
    def phase(self) -> Phase:
        """The phase of the follow law."""
        return self._law.phase

    @property
    def warning(self) -> str:
        """Why the vehicle is not led as usual, in words; else ""."""
        mode = self._mode
        if mode is None:
            return ""
        if self.is_on and not self.leads:
            return f"not led: enter {mode.name} again, in the air"
        if mode.needs_stream and self._must_wait() and self._intends_mode:
            return f"PX4 would return to {mode.name} by itself: choose Hold, then {mode.name}"
        return "range unsure: comes no nearer" if self.leads and self._law.is_unsure else ""

    def receive(self, message: Message) -> None:
        """Take a message of the autopilot: mode, whether it flies, parameters."""
        if self._mode is None:
            return
        if isinstance(message, Heartbeat):
            self._take_mode(self._mode.is_on(message.custom_mode) and message.armed)
        elif isinstance(message, CurrentMode):
            self._intends_mode = self._mode.is_on(message.intended_mode)
            self._has_led = self._has_led and (self._intends_mode or message.intended_mode == 0)
        elif isinstance(message, LandedState) and message.on_ground is not None:
            self._is_on_ground = message.on_ground
        elif isinstance(message, ParamValue):
            self._law.limits, words = limited_by(self._law.limits, self._mode, message.name, message.value)
            if words:
                self.parameter_texts.append(words)

    def _take_mode(self, is_on: bool) -> None:
        """The mode is entered where it was not on before, or where this daemon led in an earlier run."""
        if not is_on:
            self.leads = False
            self._has_led = self._has_led and self._intends_mode is not False
        elif not self.is_on and (self._has_led if self._is_first_mode else self._is_ready()):
            self.leads = self._has_led = True
        self.is_on, self._is_first_mode = is_on, False

    def _is_ready(self) -> bool:
        is_streaming = self._streams or not (self._mode and self._mode.needs_stream)
        return is_streaming and self._own is not None and not self._is_on_ground

    def resume(self, known: LeaderState, course: float | None, *, has_led: bool) -> None:
        """Continue what an earlier run knew, and led. Its leader counts as lost since then."""
        self._leader.resume(known, course)
        self._seen_ns = self._t_ns = known.t_ns
        self._has_led = has_led

    def step(self, state: LeaderState | None, own: Follower, t_ns: int) -> None:
        """Make setpoint and smoothed leader of a time on the boot clock."""
        pause_s = 0.0 if self._t_ns is None else max((t_ns - self._t_ns) / NS_PER_S, 0.0)
        dt = min(pause_s, MAX_STEP_S)
        if pause_s > dt:
            self._leader.coast(min(pause_s, REMEMBERED_S) - dt)
        self._t_ns = t_ns
        self._waited_s += pause_s
        is_own_known = bool(np.isfinite(own.r_F).all() and np.isfinite(own.v_F).all())
        if is_own_known:
            self._follow_reset(own, dt)
            self._own = own
            if own.q_nb is not None and self._camera is not None:
                self._framing.update(self._camera, own.q_nb, dt)
        turn = self._track(state, own.r_F if is_own_known else None, dt)
        self.setpoint = self._next(own if is_own_known else None, turn, dt)

    def _follow_reset(self, own: Follower, dt: float) -> None:
        """Move with the origin of n, which a reset of the autopilot's filter has moved."""
        before = self._own
        if before is None or dt == 0.0:
            return
        step = own.r_F - before.r_F - dt * own.v_F
        if float(np.linalg.norm(step)) > MAX_POSITION_STEP_M:
            self._law.shift(step)
            self._leader.shift(step)

    def _track(self, state: LeaderState | None, r_F: Array | None, dt: float) -> float:
        """Follow the leader, or let it fly on. Returns the rate of the slot's course, rad/s."""
        leader, is_seen = self._leader, state is not None and is_usable(state)
        if is_seen:
            assert state is not None  # noqa: S101 - it is seen
            if self._lost_s() > COAST_S:
                leader.restart()
            leader.see(state, dt)
            self._seen_ns = self._t_ns
        elif leader.is_known and self._lost_s() > 0.0:
            leader.coast(dt)
        self.smoothed = None
        if state is not None and state.valid and is_seen:
            vectors = {"r_OL_n": leader.r, "v_L_n": leader.v, "a_L_n": leader.a}
            made = {name: tuple(vector.tolist()) for name, vector in vectors.items()}
            self.smoothed = replace(state, **made, course=leader.course)
        if r_F is None or not leader.is_known:
            return 0.0
        return leader.turn(r_F, self._law.max_turn_rate(leader), dt, is_seen=is_seen)

    def _lost_s(self) -> float:
        """Seconds since the leader was seen."""
        if self._seen_ns is None or self._t_ns is None:
            return math.inf
        return (self._t_ns - self._seen_ns) / NS_PER_S

    def _next(self, own: Follower | None, turn: float, dt: float) -> ReferenceState | None:
        """The setpoint: the law's while it leads, else the vehicle's own motion where the mode needs a stream."""
        mode = self._mode
        if mode is None or self._own is None:
            return None
        if self.leads and self._law.has_begun:
            r_F = None if own is None else own.r_F
            return self._law.step(self._leader, self._lost_s(), turn, r_F, dt, self._framing.lift)
        self._streams = mode.needs_stream and not self._must_wait()
        if own is not None or not self._streams:
            yaw = 0.0 if self._own.q_nb is None else euler_from_quaternion(self._own.q_nb)[2]
            self.setpoint = self._law.begin(self._own.r_F, self._own.v_F, yaw)
        return self.setpoint if self._streams else None

    def _must_wait(self) -> bool:
        """Whether a stream may not begin: PX4 would return to its mode by itself, or has not said yet whether."""
        if self._has_led or self._streams:
            return False
        is_unknown = self._intends_mode is None and self._waited_s < MODE_WAIT_S
        return self.is_on or bool(self._intends_mode) or is_unknown


def is_usable(state: LeaderState) -> bool:
    """Whether guidance may follow a state: it is valid, or withheld only because the leader, which is in the
    image, moves as no hypothesis expects; its direction holds then, and its sigmas say how little else does."""
    if state.r_OL_n is None:
        return False
    return state.valid or state.cause is Cause.UNEXPECTED
