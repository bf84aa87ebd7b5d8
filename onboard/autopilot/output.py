"""MAVLink output by link: sessions, the leader, our odometry, other traffic."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard.autopilot.guidance import Follower, Guidance, setpoint_mode
from onboard.autopilot.leader_messages import OWN_SYSTEM, CameraView
from onboard.autopilot.leader_output import SETPOINT, LeaderOutput
from onboard.autopilot.leader_state import LeaderStates, as_vec3
from onboard.autopilot.notices import WARNING, Notices, Rank
from onboard.autopilot.odometry import OdometryStream
from onboard.autopilot.parameters import Parameters
from onboard.autopilot.rations import Rations
from onboard.autopilot.reasons import Reasons
from onboard.autopilot.requests import Requests, sender_of, version
from onboard.autopilot.session import Session
from onboard.autopilot.traffic import TrafficOutput
from onboard.config import Config, source_delays_ns
from onboard.messages import (
    WARM_VERSION,
    Command,
    ComputerStatus,
    Estimate,
    FollowTarget,
    GlobalPosition,
    Heartbeat,
    LeaderState,
    Message,
    NavState,
    Output,
    Setpoint,
    WarmState,
)
from onboard.messages.causes import Cause, Reason
from onboard.messages.mavlink_enums import PX4
from onboard.units import NS_PER_S
from onboard.wire.datagrams import OnRefused, ignore
from onboard.wire.mavlink.signing import Signer

OTHER_TARGET: Final = Reason(
    Cause.OTHER_TARGET, "it sends FOLLOW_TARGET, too, and an autopilot follows whoever sent one last"
)
MAX_WARM_AGE_NS: Final = NS_PER_S  # of an estimate that the next run can continue


class Outgoing(NamedTuple):
    """Frames for the link of a channel."""

    channel: str
    frames: list[bytes]


class AutopilotOutput:
    """All MAVLink output, as frames to be sent. Before `connect` these are heartbeats only."""

    def __init__(
        self,
        config: Config,
        parameters: Parameters | None = None,
        keys: Mapping[str, bytes] | None = None,
        refuse: OnRefused = ignore,
    ) -> None:
        self._signers = {name: Signer(key, link_id) for link_id, (name, key) in enumerate((keys or {}).items())}
        self.leader: LeaderState | None = None  # as of the last tick that wanted it
        self._config, self._camera = config, config.camera_model()
        self._autopilot: Heartbeat | None = None
        self._sends_setpoints = any(SETPOINT in out.rates_hz for out in config.leader_out)
        self._sends_target = any("FOLLOW_TARGET" in out.rates_hz for out in config.leader_out)
        self._refuse = refuse
        self.notices, self._reasons = Notices(), Reasons()
        self._texts: list[str] = []  # queued as notices, not yet taken as lines
        self._requests = Requests(config.autopilot.trusted, refuse)
        self._requests.offer("AUTOPILOT_VERSION", version)
        parameters = parameters or Parameters(config)
        self._rations = Rations()
        self._sessions = {
            link.name: Session(config.autopilot, link.name, self._requests, parameters, self._rations, refuse)
            for link in config.link
            if link.is_autopilot
        }
        for link in config.link:
            if link.speaks_first:
                self._sessions[link.name].introduce()
        self._traffic = TrafficOutput(config.traffic_out, config.autopilot.component)
        self._odometry: OdometryStream | None = None
        self._leader_outputs: list[LeaderOutput] = []
        self._leader_states = LeaderStates(config.ownship.errors, config.ownship.max_age_s)
        self._guidance = Guidance(config.guidance, self._camera)
        self._smoothed: LeaderState | None = None
        self.is_armed: bool | None = None  # None before a heartbeat

    def signed(self, channel: str, frame: bytes, wall_ns: int) -> bytes:
        """Sign a frame if its channel's link has a key. `wall_ns`: Unix time."""
        signer = self._signers.get(channel)
        return frame if signer is None else signer.sign(frame, wall_ns)

    def take_lines(self) -> list[str]:
        """Return the lines for a person since the last call; they are sent as STATUSTEXT, too.

        Refused values are sent alone: the health names them, once for many.
        """
        lines: list[str] = []
        for session in self._sessions.values():
            for sender, line in session.refusals:
                self.notices.add(WARNING, line, Rank.OTHERS, sender)
            session.refusals.clear()
        for line in self._requests.lines:
            self.notices.add(WARNING, line)
            lines.append(line)
        self._requests.lines.clear()
        lines += self._texts
        self._texts.clear()
        return lines

    def is_autopilot(self, channel: str) -> bool:
        """Whether there is a session on this channel's link."""
        return channel in self._sessions

    def connect(self, autopilot: Heartbeat) -> list[str]:
        """Become a component of an autopilot's system on all links.

        Returns lines for a person about what cannot be sent."""
        config, ids = self._config, (autopilot.system, self._config.autopilot.component)
        self._autopilot = autopilot
        self._requests.clear_streams()
        mode = setpoint_mode(autopilot) if self._sends_setpoints else None
        parameters = () if mode is None else (*mode.limits, *mode.advice)
        for session in self._sessions.values():
            session.connect(autopilot, parameters, () if mode is None else mode.messages)
        self._traffic.connect(autopilot.system)
        self._odometry = OdometryStream(*ids, rate_hz=config.odometry.rate_hz)
        usable = [out for out in config.leader_out if out.system != autopilot.system]
        self._leader_outputs = [LeaderOutput(out, *ids) for out in usable]
        self._leader_states.restart()
        self._guidance = Guidance(config.guidance, self._camera, mode)
        self._leader_states.delay_ns = source_delays_ns(config.delay, autopilot.autopilot)[GlobalPosition]
        self._offer()
        lines = [
            f"leader_out on {out.link}: `system` {out.system} is the autopilot's own; set another"
            for out in config.leader_out
            if out not in usable
        ]
        if self._sends_setpoints and mode is None:
            lines.append(
                "leader_out: no setpoints are sent: the autopilot is not PX4 or ArduCopter on a multirotor"
            )
        return lines

    def _offer(self) -> None:
        """Register all streams for requests."""
        offer = self._requests.offer_stream
        odometry, traffic = self._odometry, self._traffic
        if self._config.odometry.link is not None and odometry is not None:
            offer(self._config.odometry.link, "ODOMETRY", odometry.stream, lambda: odometry.can_send)
        if traffic.link:
            for name, stream in traffic.streams.items():
                offer(traffic.link, name, stream, lambda: True)
        for out in self._leader_outputs:
            out.offer(self._requests, self._camera, self._config.camera.name, self._can_send)

    def _can_send(self, out: LeaderOutput, name: str) -> bool:
        if name == SETPOINT:
            return self._guidance.setpoint is not None
        return out.can_send(name, self._smoothed if name in OWN_SYSTEM else self.leader, self._view())

    def reboot(self) -> None:
        """Start again with an autopilot that has rebooted."""
        self._leader_states.restart()
        self._guidance.restart()
        for session in self._sessions.values():
            session.reboot()

    def resume(self, state: WarmState) -> None:
        """Continue an earlier run. Call it after `connect`."""
        before = LeaderStates(self._config.ownship.errors)
        for known in (state.own, state.estimate):
            before.update(known)
        if (leader := before.at(state.t_ns, state.wall_ns)) is not None and leader.valid:
            self._guidance.resume(leader, state.course, has_led=state.led)

    def warm_state(self, wall_ns: int, offset_ns: int | None, round_trip_ns: int | None) -> WarmState | None:
        """Return what the next run needs to continue; None without a valid, recent leader.

        `offset_ns`: of the wall clock from the boot clock."""
        latest, autopilot = self._leader_states.latest, self._autopilot
        if latest is None or latest.own is None or autopilot is None or offset_ns is None:
            return None
        e = latest.estimate
        if not e.valid or wall_ns - offset_ns - e.t_ns > MAX_WARM_AGE_NS:
            return None
        return WarmState(
            t_ns=e.t_ns,
            t_recv_ns=wall_ns,
            version=WARM_VERSION,
            configuration="",
            wall_ns=e.t_ns + offset_ns,
            heartbeat=autopilot,
            estimate=replace(e, measurement=None, modes=()),
            own=latest.own,
            course=self._guidance.course,
            led=self._guidance.is_leading,
            offset_ns=offset_ns,
            round_trip_ns=round_trip_ns,
        )

    def publish(self, output: Output) -> Iterator[Outgoing]:
        """Return the frames for an estimate: our own state as ODOMETRY, other targets as traffic."""
        self._leader_states.update(output)
        if isinstance(output, Estimate):
            self.notices.report_leader(output)
        if isinstance(output, NavState):
            if self._config.odometry.link is not None and self._odometry is not None:
                yield Outgoing(self._config.odometry.link, self._odometry.frames(output))
        elif isinstance(output, Estimate) and not output.is_primary and self._traffic.link:
            yield Outgoing(self._traffic.link, self._traffic.frames(output))

    def respond(self, channel: str, messages: Sequence[Message], now_ns: int) -> Outgoing:
        """Answer the messages of a channel, on the same channel."""
        if (mine := self._autopilot) is not None:
            self._leader_states.receive(messages, mine.system, mine.component)
            for m in messages:
                if (m.system, m.component) != (mine.system, mine.component):
                    continue
                if isinstance(m, Heartbeat):
                    self._autopilot, self.is_armed = m, m.armed  # the next run resumes in this mode
                self._guidance.receive(m)
        for m in messages:
            if isinstance(m, FollowTarget) and self._sends_target:
                self._refuse(sender_of(m), OTHER_TARGET, m.t_recv_ns)
        frames = self._sessions[channel].respond(messages, now_ns)
        for out in self._leader_outputs:
            if out.link == channel:
                frames.extend(self._camera_answers(out, messages, now_ns))
        return Outgoing(channel, frames)

    def _camera_answers(self, out: LeaderOutput, messages: Sequence[Message], now_ns: int) -> Iterator[bytes]:
        """Answer commands to a camera, within the rations of their senders."""
        for message in messages:
            if isinstance(message, Command) and self._rations.admits(message, now_ns):
                answers = out.respond([message], now_ns)
                self._rations.spend(message, sum(map(len, answers)), now_ns)
                yield from answers

    def set_computer_status(self, status: ComputerStatus) -> None:
        """Set the state of this computer, which the sessions send."""
        for session in self._sessions.values():
            session.computer = status

    def tick(
        self,
        now_ns: int,
        *,
        healthy: bool,
        rates: Mapping[str, float],
        boot_ns: int | None = None,
        host_ns: int | None = None,
        wants_leader: bool = True,
    ) -> Iterator[Outgoing]:
        """Return the frames due at `now_ns`; see `Session.tick`.

        `boot_ns`: the same time on the boot clock, None if not known. `host_ns`: on the wall clock, by default
        `now_ns`. `wants_leader`: update `leader` even if it is not sent."""
        wants_origin = not self._leader_states.has_stated_origin
        texts = self.notices.due(now_ns) if self._autopilot is not None else []
        for channel, session in self._sessions.items():
            frames = session.tick(now_ns, healthy=healthy, rates=rates, wants_origin=wants_origin)
            frames.extend(map(session.encode, texts))
            yield Outgoing(channel, frames)
        if boot_ns is None or not (wants_leader or self._leader_outputs):
            return
        self._guide(boot_ns, now_ns if host_ns is None else host_ns)
        view = self._view()
        self._explain(view, now_ns)
        setpoint = self._setpoint(boot_ns)
        for out in self._leader_outputs:
            yield Outgoing(out.link, out.frames(self.leader, self._smoothed, view, now_ns, setpoint))

    def _guide(self, boot_ns: int, host_ns: int) -> None:
        """Update the leader, its smoothed state and the setpoint to a time."""
        states, guidance = self._leader_states, self._guidance
        state = states.at(boot_ns, host_ns)
        guidance.step(state, Follower(*states.own_at(boot_ns), states.q_nb), boot_ns)
        self.notices.is_leading = guidance.is_leading
        self._smoothed = None if guidance.smoothed is None else states.locate(guidance.smoothed)
        self.leader = replace(state, course=guidance.course) if state is not None and state.valid else state

    def _setpoint(self, boot_ns: int) -> Setpoint | None:
        """Return the setpoint of this tick as a record, None for silence."""
        wanted, autopilot = self._guidance.setpoint, self._autopilot
        if wanted is None or autopilot is None:
            return None
        r, v, a = (as_vec3(vector) for vector in (wanted.r, wanted.v, wanted.a))
        return Setpoint(
            t_ns=boot_ns,
            t_recv_ns=boot_ns,
            target_system=autopilot.system,
            target_component=autopilot.component,
            r_OF_n=r,
            v_F_n=v,
            a_F_n=a,
            yaw=wanted.yaw,
            yaw_rate=wanted.yaw_rate,
        )

    def _explain(self, view: CameraView | None, now_ns: int) -> None:
        """Queue the reasons why the vehicle is not led."""
        if self._autopilot is None:
            return
        guidance = self._guidance
        texts = self._reasons.tick(
            self.leader,
            view,
            now_ns,
            warning=guidance.warning,
            is_entered=guidance.is_mode_on,
            is_armed=bool(self.is_armed),
        )
        texts += [(WARNING, text) for text in guidance.parameter_texts]
        guidance.parameter_texts.clear()
        for severity, text in texts:
            self.notices.add(severity, text)
            self._texts.append(text)

    def _view(self) -> CameraView | None:
        q_nb = self._leader_states.q_nb
        is_px4 = self._autopilot is not None and self._autopilot.autopilot == PX4
        return None if q_nb is None else CameraView(q_nb, self._camera, is_px4)
