"""The conversation with an autopilot on one link: sans-IO, time is an argument.

A good citizen: a heartbeat a second as an onboard controller, TIMESYNC requests to know the clock offset, the
message rates we need (asked once per boot and again while they are missing, since an autopilot forgets them on
reboot), replies to TIMESYNC requests, and an answer to every command that is addressed to us.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.component import Component, heartbeat
from onboard.autopilot.parameters import Parameters
from onboard.autopilot.rations import STORED, Rations
from onboard.autopilot.requests import Requests, sender_of, stamp
from onboard.autopilot.stream import Stream
from onboard.config import AutopilotConfig, Config
from onboard.messages import (
    Command,
    CommandAck,
    ComputerStatus,
    Heartbeat,
    Message,
    ParamAction,
    ParamRequest,
    ParamValue,
    Ping,
    TimeSync,
    tagged,
)
from onboard.messages.causes import Cause, Reason
from onboard.messages.mavlink_enums import ARDUPILOT
from onboard.messages.senders import SENDERS, Sender
from onboard.units import NS_PER_S
from onboard.wire.datagrams import OnRefused, ignore
from onboard.wire.mavlink.encode import message_number

TIMESYNC_HZ: Final = 5.0
ASK_AGAIN_NS: Final = 5 * NS_PER_S
STATUS_HZ: Final = 5.0
SLOW: Final = 0.7  # a stream below this share of its wanted rate is asked for again
USUAL_SYSTEM: Final = 1  # of an autopilot that nobody has numbered
ACTIVE: Final = 4
CRITICAL: Final = 5
DONE: Final = frozenset({0, 5})  # MAV_RESULT accepted, in progress
ORIGIN_AGAIN_NS: Final = 5 * NS_PER_S
PARAMETER_ASKS: Final = 3  # per boot: not every autopilot has what is asked for
RATIONED: Final = Reason(Cause.RATIONED, "answers are rationed: it asks for too much in too short a time")


class Session:
    """The conversation on one link. Nothing but `introduce` is sent before an autopilot is heard. `computer` is
    the state of this computer, if it is known."""

    def __init__(
        self,
        config: AutopilotConfig,
        channel: str = "",
        requests: Requests | None = None,
        parameters: Parameters | None = None,
        rations: Rations | None = None,
        refuse: OnRefused = ignore,
    ) -> None:
        self.refusals: list[tuple[str, str]] = []  # sender and line for a person, since they were taken
        self._config, self._channel, self._requests_of_us = config, channel, requests or Requests()
        self._parameters, self._rations = parameters or Parameters(Config()), rations or Rations()
        self._refuse = refuse
        self._refusals = self._status_requests = 0
        self.computer: ComputerStatus | None = None
        self._us: Component | None = None
        self._autopilot: Heartbeat | None = None
        self._parameters_of_it: tuple[str, ...] = ()
        self._messages: tuple[str, ...] = ()
        self._heartbeats, self._timesyncs = Stream(1.0, fixed=True), Stream(TIMESYNC_HZ, fixed=True)
        self._computer_statuses = Stream(1.0)
        self.reboot()

    def introduce(self) -> None:
        """Send heartbeats before an autopilot is heard: PX4 on USB, and servers on UDP, speak only to who has
        spoken. Its system may be another than that of most autopilots, which we then take."""
        system = self._config.system or USUAL_SYSTEM
        self._us = Component(system, self._config.component, self._channel, self._requests_of_us)

    def connect(self, autopilot: Heartbeat, parameters: Iterable[str] = (), messages: Iterable[str] = ()) -> None:
        """An autopilot was heard: we are a component of its system. It is asked for `parameters`, of which not
        every version has each, and for `messages` beside those of the configuration."""
        self._autopilot, self._parameters_of_it, self._messages = autopilot, tuple(parameters), tuple(messages)
        self._us = Component(autopilot.system, self._config.component, self._channel, self._requests_of_us)
        offer = self._requests_of_us.offer_stream
        offer(self._channel, "HEARTBEAT", self._heartbeats, lambda: True)
        offer(self._channel, "TIMESYNC", self._timesyncs, lambda: True)
        offer(self._channel, "ONBOARD_COMPUTER_STATUS", self._computer_statuses, lambda: self.computer is not None)
        self.reboot()

    def reboot(self) -> None:
        """The autopilot has rebooted and forgotten what we asked for."""
        self._next_request = 0
        self._has_asked_status = False  # once per boot: not every autopilot has it
        self._next_origin = 0
        self._asks_left, self._known_parameters = PARAMETER_ASKS, set[str]()

    def tick(
        self, now_ns: int, *, healthy: bool, rates: Mapping[str, float], wants_origin: bool = False
    ) -> list[bytes]:
        """Frames due at `now_ns` (this computer's clock). `healthy` shows in the heartbeat; `rates` are the
        rates of the MAVLink messages received, Hz; `wants_origin`: GPS_GLOBAL_ORIGIN is requested until it
        comes."""
        frames = []
        if self._us is not None and self._heartbeats.is_due(now_ns):
            frames.append(self._pack(heartbeat(ACTIVE if healthy else CRITICAL)))
        if self._autopilot is None:
            return frames
        if self.computer is not None and self._computer_statuses.is_due(now_ns):
            frames.append(self._pack(self.computer))
        if self._timesyncs.is_due(now_ns):
            frames.append(self._pack(TimeSync(**stamp(now_ns), tc1_ns=0, ts1_ns=tagged(now_ns))))
        if self._config.request_rates and now_ns >= self._next_request:
            self._next_request = now_ns + ASK_AGAIN_NS
            frames.extend(self._requests(now_ns, rates))
            if not self._has_asked_status:
                self._has_asked_status = True
                asked = self._request_status(now_ns)
                self._status_requests += len(asked)
                frames.extend(asked)
            if self._asks_left:
                self._asks_left -= 1
                missing = (name for name in self._parameters_of_it if name not in self._known_parameters)
                frames.extend(self._request_parameter(name, now_ns) for name in missing)
        if wants_origin and self._config.request_rates and now_ns >= self._next_origin:
            self._next_origin = now_ns + ORIGIN_AGAIN_NS
            frames.append(self._request_once("GPS_GLOBAL_ORIGIN", now_ns))
        return frames

    def respond(self, messages: Sequence[Message], now_ns: int) -> list[bytes]:
        """Answers to requests of the autopilot, and of others through it or beside it."""
        us = self._us
        if us is None or self._autopilot is None:
            return []
        frames = []
        for m in messages:
            is_its = (m.system, m.component) == (self._autopilot.system, self._autopilot.component)
            if isinstance(m, ParamValue) and is_its:
                self._known_parameters.add(m.name)
            elif isinstance(m, CommandAck) and is_its and us.is_target(m):
                self._read_ack(m)
            if Sender.ASKER not in SENDERS.get(type(m), Sender.AUTOPILOT):
                continue
            if not self._rations.admits(m, now_ns):
                self._refuse(sender_of(m), RATIONED, m.t_recv_ns)
                continue
            answers = self._answer(us, m, now_ns)
            size = sum(map(len, answers))
            is_set = isinstance(m, ParamRequest) and m.action is ParamAction.SET and us.is_target(m)
            self._rations.spend(m, size + STORED * is_set, now_ns)
            frames += answers
        return frames

    def _answer(self, us: Component, m: Message, now_ns: int) -> list[bytes]:
        """What to send on one message."""
        if isinstance(m, TimeSync) and m.tc1_ns == 0:
            return [self._pack(TimeSync(**stamp(now_ns), tc1_ns=now_ns, ts1_ns=m.ts1_ns))]
        if isinstance(m, Ping) and m.target_system == m.target_component == 0:
            return [self._pack(_pong(m, now_ns))]
        if isinstance(m, ParamRequest) and us.is_target(m):
            replies, refusal = self._parameters.answer(m, now_ns)
            if refusal:
                self.refusals.append((sender_of(m), f"refused: {refusal}"))
                self._refuse(sender_of(m), Reason(Cause.DOCUMENT, refusal), m.t_recv_ns)
            return list(map(self._pack, replies))
        if isinstance(m, Command) and us.is_target(m):
            return us.answer(m, now_ns)
        return []

    def _read_ack(self, m: CommandAck) -> None:
        """A refusal of our requests for message rates is named in the health; the answer does not say which
        message. The filter's status, which not every autopilot has, may be refused."""
        if m.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL or m.result in DONE:
            return
        self._refusals += 1
        if self._refusals > self._status_requests:
            words = f"the autopilot refuses a message rate (MAV_RESULT {m.result})"
            self._refuse("autopilot", Reason(Cause.RATE_REFUSED, words), m.t_recv_ns)

    def _requests(self, now_ns: int, rates: Mapping[str, float]) -> list[bytes]:
        """SET_MESSAGE_INTERVAL for each stream that is too slow."""
        frames = []
        for name, wanted in self._config.rates_hz.items():
            if rates.get(name, 0.0) >= SLOW * wanted:
                continue
            frames.append(self._request(name, wanted, now_ns))
        return frames

    def _request_status(self, now_ns: int) -> list[bytes]:
        """SET_MESSAGE_INTERVAL for the status of the autopilot's filter. A PX4 says in ODOMETRY alone how far its
        yaw may be off: at rest, by 10 degrees."""
        is_ardupilot = self._autopilot is not None and self._autopilot.autopilot == ARDUPILOT
        names = ("EKF_STATUS_REPORT",) if is_ardupilot else ("ESTIMATOR_STATUS", "ODOMETRY")
        return [self._request(name, STATUS_HZ, now_ns) for name in (*names, *self._messages)]

    def _request(self, name: str, rate_hz: float, now_ns: int) -> bytes:
        return self._command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_number(name), 1e6 / rate_hz, now_ns)

    def _request_once(self, name: str, now_ns: int) -> bytes:
        return self._command(dialect.MAV_CMD_REQUEST_MESSAGE, message_number(name), 0.0, now_ns)

    def _request_parameter(self, name: str, now_ns: int) -> bytes:
        """PARAM_REQUEST_READ to the autopilot."""
        to = self._to_autopilot(now_ns)
        return self._pack(ParamRequest(**to, action=ParamAction.READ, extended=False, name=name))

    def _command(self, number: int, first: float, second: float, now_ns: int) -> bytes:
        """A command to the autopilot."""
        params = (float(first), second, 0.0, 0.0, 0.0, 0.0, 0.0)
        return self._pack(Command(**self._to_autopilot(now_ns), command=number, params=params))

    def _to_autopilot(self, now_ns: int) -> dict[str, Any]:
        """The times of a record that we send, and its target."""
        mine = self._autopilot
        target = (0, 0) if mine is None else (mine.system, mine.component)
        return {**stamp(now_ns), "target_system": target[0], "target_component": target[1]}

    def encode(self, message: Message) -> bytes:
        """A message of ours as a frame. Call `connect` first."""
        return self._pack(message)

    def _pack(self, message: Message) -> bytes:
        assert self._us is not None  # noqa: S101 - connect() comes before anything is packed
        return self._us.encode(message)


def _pong(m: Ping, now_ns: int) -> Ping:
    """The answer to a PING, to its sender."""
    return Ping(
        **stamp(now_ns), time_us=m.time_us, number=m.number, target_system=m.system, target_component=m.component
    )
