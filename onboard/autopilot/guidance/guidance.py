"""When the vehicle is led, and by which setpoints.

The pilot alone changes modes. The vehicle is led once its mode is entered in the air while guidance is ready, and
until the mode is left. In the mode the stream of setpoints never ends: its end is the autopilot's failsafe.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.autopilot.framing import Framing
from onboard.autopilot.guidance.autopilots import SetpointMode, apply_parameter
from onboard.autopilot.guidance.law import FollowLaw, Phase, ReferenceState
from onboard.autopilot.guidance.leader import LeaderTrack
from onboard.config import GuidanceConfig
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import CurrentMode, Heartbeat, LandedState, LeaderState, Message, ParamValue, Quaternion
from onboard.messages.causes import Cause
from onboard.units import NS_PER_S

MAX_STEP_S: Final = 0.1  # of the law; a longer pause is no step
MAX_POSITION_STEP_M: Final = 2.0  # beyond our own velocity; more is a reset of the autopilot's filter
MODE_TIMEOUT_S: Final = 5.0  # of CURRENT_MODE, which PX4 sends since 1.15
RESTART_TIMEOUT_S: Final = 1.0  # a leader that was lost for longer is not smoothed with its earlier motion
MAX_COAST_TIME_S: Final = 10.0  # across a pause of this program; a warm start's state is not older


class Follower(NamedTuple):
    """Our own position and velocity (3,) in n, NaN where not known, and attitude."""

    r_F: Array
    v_F: Array
    q_nb: Quaternion | None


class Guidance:
    """The follow law, and whether its setpoints are sent."""

    def __init__(
        self, config: GuidanceConfig, camera: Camera | None = None, mode: SetpointMode | None = None
    ) -> None:
        self._config, self._camera, self._mode = config, camera, mode
        self.parameter_texts: list[str] = []  # warnings about the autopilot's parameters; the caller clears them
        self.restart()

    def restart(self) -> None:
        """Forget the leader and the vehicle, whose autopilot has rebooted."""
        self._law, self._leader = FollowLaw(self._config), LeaderTrack()
        self._framing = Framing(self._config.slot_m)
        self.setpoint: ReferenceState | None = None  # to send now; None for silence
        self.smoothed: LeaderState | None = None  # the leader as FOLLOW_TARGET reports it
        self.is_mode_on = self.is_leading = False
        self._has_led = self._is_streaming = self._is_on_ground = False
        self._is_first_mode = True
        self._is_mode_intended: bool | None = None  # PX4 is in the mode, or returns to it at the next setpoint
        self._t_ns: int | None = None
        self._run_time_s = 0.0
        self._last_seen_ns: int | None = None
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
        """Why the vehicle is not led, or does not close in, with what to do; "" if all is well."""
        mode = self._mode
        if mode is None:
            return ""
        if self.is_mode_on and not self.is_leading:
            return f"not led: enter {mode.name} again, in the air"
        if mode.needs_stream and self._must_wait() and self._is_mode_intended:
            return f"PX4 would return to {mode.name} by itself: choose Hold, then {mode.name}"
        return "range unsure: not closing in" if self.is_leading and self._law.is_range_unsure else ""

    def receive(self, message: Message) -> None:
        """Read the autopilot's mode, parameters, and whether it is on the ground."""
        if self._mode is None:
            return
        if isinstance(message, Heartbeat):
            self._update_mode(self._mode.is_on(message.custom_mode) and message.armed)
        elif isinstance(message, CurrentMode):
            self._is_mode_intended = self._mode.is_on(message.intended_mode)
            self._has_led = self._has_led and (self._is_mode_intended or message.intended_mode == 0)
        elif isinstance(message, LandedState) and message.on_ground is not None:
            self._is_on_ground = message.on_ground
        elif isinstance(message, ParamValue):
            self._law.limits, text = apply_parameter(self._law.limits, self._mode, message.name, message.value)
            if text:
                self.parameter_texts.append(text)

    def _update_mode(self, is_on: bool) -> None:
        """Begin to lead when the mode is entered, or when resuming; end when it is left."""
        if not is_on:
            self.is_leading = False
            self._has_led = self._has_led and self._is_mode_intended is not False
        elif not self.is_mode_on and (self._has_led if self._is_first_mode else self._is_ready()):
            self.is_leading = self._has_led = True
        self.is_mode_on, self._is_first_mode = is_on, False

    def _is_ready(self) -> bool:
        is_streaming = self._is_streaming or not (self._mode and self._mode.needs_stream)
        return is_streaming and self._own is not None and not self._is_on_ground

    def resume(self, known: LeaderState, course: float | None, *, has_led: bool) -> None:
        """Continue an earlier run, whose leader counts as lost since then."""
        self._leader.resume(known, course)
        self._last_seen_ns = self._t_ns = known.t_ns
        self._has_led = has_led

    def step(self, state: LeaderState | None, own: Follower, t_ns: int) -> None:
        """Update `setpoint` and `smoothed` to a time on the boot clock."""
        pause_s = 0.0 if self._t_ns is None else max((t_ns - self._t_ns) / NS_PER_S, 0.0)
        dt = min(pause_s, MAX_STEP_S)
        if pause_s > dt:
            self._leader.coast(min(pause_s, MAX_COAST_TIME_S) - dt)
        self._t_ns = t_ns
        self._run_time_s += pause_s
        is_own_known = bool(np.isfinite(own.r_F).all() and np.isfinite(own.v_F).all())
        if is_own_known:
            self._follow_reset(own, dt)
            self._own = own
            if own.q_nb is not None and self._camera is not None:
                self._framing.update(self._camera, own.q_nb, dt)
        turn_rate = self._update_leader(state, own.r_F if is_own_known else None, dt)
        self.setpoint = self._make_setpoint(own if is_own_known else None, turn_rate, dt)

    def _follow_reset(self, own: Follower, dt: float) -> None:
        """Shift leader and reference with our position after a reset of the autopilot's filter."""
        before = self._own
        if before is None or dt == 0.0:
            return
        step = own.r_F - before.r_F - dt * own.v_F
        if float(np.linalg.norm(step)) > MAX_POSITION_STEP_M:
            self._law.shift(step)
            self._leader.shift(step)

    def _update_leader(self, state: LeaderState | None, r_F: Array | None, dt: float) -> float:
        """Smooth the leader, or let it coast. Returns the rate of the slot's course, rad/s."""
        leader = self._leader
        usable = state if state is not None and is_usable(state) else None
        if usable is not None:
            if self._outage_s() > RESTART_TIMEOUT_S:
                leader.restart()
            leader.update(usable, dt)
            self._last_seen_ns = self._t_ns
        elif leader.is_known and self._outage_s() > 0.0:
            leader.coast(dt)
        self.smoothed = None
        if usable is not None and usable.valid:
            vectors = {"r_OL_n": leader.r, "v_L_n": leader.v, "a_L_n": leader.a}
            fields = {name: tuple(vector.tolist()) for name, vector in vectors.items()}
            self.smoothed = replace(usable, **fields, course=leader.course)
        if r_F is None or not leader.is_known:
            return 0.0
        return leader.turn_slot(r_F, self._law.max_turn_rate(leader), dt, is_seen=usable is not None)

    def _outage_s(self) -> float:
        """Seconds since the leader was seen."""
        if self._last_seen_ns is None or self._t_ns is None:
            return math.inf
        return (self._t_ns - self._last_seen_ns) / NS_PER_S

    def _make_setpoint(self, own: Follower | None, turn_rate: float, dt: float) -> ReferenceState | None:
        """Return the law's setpoint, or our own motion while a mode only needs a stream."""
        mode = self._mode
        if mode is None or self._own is None:
            return None
        if self.is_leading and self._law.has_begun:
            r_F = None if own is None else own.r_F
            return self._law.step(self._leader, self._outage_s(), turn_rate, r_F, dt, self._framing.lift)
        self._is_streaming = mode.needs_stream and not self._must_wait()
        if own is not None or not self._is_streaming:
            yaw = 0.0 if self._own.q_nb is None else euler_from_quaternion(self._own.q_nb)[2]
            self.setpoint = self._law.begin(self._own.r_F, self._own.v_F, yaw)
        return self.setpoint if self._is_streaming else None

    def _must_wait(self) -> bool:
        """Whether no stream may begin, since PX4 would or might return to its mode by itself."""
        if self._has_led or self._is_streaming:
            return False
        is_unknown = self._is_mode_intended is None and self._run_time_s < MODE_TIMEOUT_S
        return self.is_mode_on or bool(self._is_mode_intended) or is_unknown


def is_usable(state: LeaderState) -> bool:
    """Whether guidance may follow a state: valid, or withheld with the leader in the image.

    A withheld leader moves as no hypothesis expects: its direction holds, and the sigmas of the rest are wide."""
    return state.r_OL_n is not None and (state.valid or state.cause is Cause.UNEXPECTED)
