"""The conversation with an autopilot on one link: sans-IO, time is an argument.

It sends a heartbeat a second as an onboard controller, TIMESYNC requests for the clock offset, and requests for
message rates, which are repeated while a stream is too slow, since an autopilot forgets them on reboot. It replies
to TIMESYNC requests and answers every command that is addressed to us.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.component import Component, heartbeat
from onboard.autopilot.parameters import Parameters
from onboard.autopilot.rations import STORAGE_BYTES, Rations
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

TIMESYNC_RATE_HZ: Final = 5.0
REQUEST_PERIOD_NS: Final = 5 * NS_PER_S
STATUS_RATE_HZ: Final = 5.0
MIN_RATE_RATIO: Final = 0.7  # of the wanted rate; a slower stream is requested again
DEFAULT_SYSTEM_ID: Final = 1  # of an autopilot whose id was never changed
ACTIVE, CRITICAL = 4, 5  # MAV_STATE
DONE: Final = frozenset({0, 5})  # MAV_RESULT accepted, in progress
MAX_PARAMETER_ATTEMPTS: Final = 3  # per boot, since not every autopilot has every parameter
TOO_MANY_REQUESTS: Final = Reason(
    Cause.RATIONED, "answers are rationed: too many requests in a short time; send fewer"
)


class Session:
    """The conversation on one link. It begins with `introduce`, or when an autopilot is heard."""

    def __init__(
        self,
        config: AutopilotConfig,
        channel: str = "",
        requests: Requests | None = None,
        parameters: Parameters | None = None,
        rations: Rations | None = None,
        refuse: OnRefused = ignore,
    ) -> None:
        self.refusals: list[tuple[str, str]] = []  # sender and line for a person; the caller clears them
        self._config, self._channel, self._own_requests = config, channel, requests or Requests()
        self._parameters, self._rations = parameters or Parameters(Config()), rations or Rations()
        self._refuse = refuse
        self._refusals = self._status_requests = 0
        self.computer: ComputerStatus | None = None  # to be sent once a second
        self._us: Component | None = None
        self._autopilot: Heartbeat | None = None
        self._autopilot_parameters: tuple[str, ...] = ()
        self._messages: tuple[str, ...] = ()
        self._heartbeats, self._timesyncs = Stream(1.0, fixed=True), Stream(TIMESYNC_RATE_HZ, fixed=True)
        self._computer_statuses = Stream(1.0)
        self.reboot()

    def introduce(self) -> None:
        """Send heartbeats before an autopilot is heard, as PX4 on USB and UDP servers expect.

        The system id is configured or assumed until the autopilot's own is known."""
        system = self._config.system or DEFAULT_SYSTEM_ID
        self._us = Component(system, self._config.component, self._channel, self._own_requests)

    def connect(self, autopilot: Heartbeat, parameters: Iterable[str] = (), messages: Iterable[str] = ()) -> None:
        """Become a component of the system of an autopilot that was heard.

        It is asked for `parameters`, and for `messages` in addition to those of the configuration."""
        self._autopilot, self._autopilot_parameters, self._messages = autopilot, tuple(parameters), tuple(messages)
        self._us = Component(autopilot.system, self._config.component, self._channel, self._own_requests)
        offer = self._own_requests.offer_stream
        offer(self._channel, "HEARTBEAT", self._heartbeats, lambda: True)
        offer(self._channel, "TIMESYNC", self._timesyncs, lambda: True)
        offer(self._channel, "ONBOARD_COMPUTER_STATUS", self._computer_statuses, lambda: self.computer is not None)
        self.reboot()

    def reboot(self) -> None:
        """Repeat all requests to an autopilot that has rebooted."""
        self._next_request = 0
        self._has_asked_status = False  # once per boot: not every autopilot has it
        self._next_origin = 0
        self._attempts_left, self._received_parameters = MAX_PARAMETER_ATTEMPTS, set[str]()

    def tick(
        self, now_ns: int, *, healthy: bool, rates: Mapping[str, float], wants_origin: bool = False
    ) -> list[bytes]:
        """Return the frames due at `now_ns` (this computer's clock).

        `healthy` shows in the heartbeat. `rates`: of the messages received, Hz. `wants_origin`: request
        GPS_GLOBAL_ORIGIN."""
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
            self._next_request = now_ns + REQUEST_PERIOD_NS
            frames.extend(self._requests(now_ns, rates))
            if not self._has_asked_status:
                self._has_asked_status = True
                asked = self._request_status(now_ns)
                self._status_requests += len(asked)
                frames.extend(asked)
            if self._attempts_left:
                self._attempts_left -= 1
                missing = (name for name in self._autopilot_parameters if name not in self._received_parameters)
                frames.extend(self._request_parameter(name, now_ns) for name in missing)
        if wants_origin and self._config.request_rates and now_ns >= self._next_origin:
            self._next_origin = now_ns + REQUEST_PERIOD_NS
            frames.append(self._request_once("GPS_GLOBAL_ORIGIN", now_ns))
        return frames

    def respond(self, messages: Sequence[Message], now_ns: int) -> list[bytes]:
        """Answer requests of the autopilot and of other systems on the link."""
        us = self._us
        if us is None or self._autopilot is None:
            return []
        frames = []
        for m in messages:
            is_autopilot = (m.system, m.component) == (self._autopilot.system, self._autopilot.component)
            if isinstance(m, ParamValue) and is_autopilot:
                self._received_parameters.add(m.name)
            elif isinstance(m, CommandAck) and is_autopilot and us.is_target(m):
                self._read_ack(m)
            if Sender.ASKER not in SENDERS.get(type(m), Sender.AUTOPILOT):
                continue
            if not self._rations.admits(m, now_ns):
                self._refuse(sender_of(m), TOO_MANY_REQUESTS, m.t_recv_ns)
                continue
            answers = self._answer(us, m, now_ns)
            size = sum(map(len, answers))
            is_set = isinstance(m, ParamRequest) and m.action is ParamAction.SET and us.is_target(m)
            self._rations.spend(m, size + STORAGE_BYTES * is_set, now_ns)
            frames += answers
        return frames

    def _answer(self, us: Component, m: Message, now_ns: int) -> list[bytes]:
        """Return the frames that answer one message."""
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
        """Report a refused message rate in the health; the acknowledgement does not say which one.

        Requests for the filter's status may be refused: not every autopilot has it."""
        if m.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL or m.result in DONE:
            return
        self._refusals += 1
        if self._refusals > self._status_requests:
            words = f"the autopilot refuses a message rate (MAV_RESULT {m.result})"
            self._refuse("autopilot", Reason(Cause.RATE_REFUSED, words), m.t_recv_ns)

    def _requests(self, now_ns: int, rates: Mapping[str, float]) -> list[bytes]:
        """Make SET_MESSAGE_INTERVAL for each stream that is too slow."""
        frames = []
        for name, wanted in self._config.rates_hz.items():
            if rates.get(name, 0.0) >= MIN_RATE_RATIO * wanted:
                continue
            frames.append(self._request(name, wanted, now_ns))
        return frames

    def _request_status(self, now_ns: int) -> list[bytes]:
        """Make SET_MESSAGE_INTERVAL for the status of the autopilot's filter.

        PX4 reports the sigma of its yaw, 10 degrees at rest, in ODOMETRY alone."""
        is_ardupilot = self._autopilot is not None and self._autopilot.autopilot == ARDUPILOT
        names = ("EKF_STATUS_REPORT",) if is_ardupilot else ("ESTIMATOR_STATUS", "ODOMETRY")
        return [self._request(name, STATUS_RATE_HZ, now_ns) for name in (*names, *self._messages)]

    def _request(self, name: str, rate_hz: float, now_ns: int) -> bytes:
        return self._command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_number(name), 1e6 / rate_hz, now_ns)

    def _request_once(self, name: str, now_ns: int) -> bytes:
        return self._command(dialect.MAV_CMD_REQUEST_MESSAGE, message_number(name), 0.0, now_ns)

    def _request_parameter(self, name: str, now_ns: int) -> bytes:
        """Make PARAM_REQUEST_READ to the autopilot."""
        to = self._to_autopilot(now_ns)
        return self._pack(ParamRequest(**to, action=ParamAction.READ, extended=False, name=name))

    def _command(self, number: int, first: float, second: float, now_ns: int) -> bytes:
        """Make a command to the autopilot."""
        params = (float(first), second, 0.0, 0.0, 0.0, 0.0, 0.0)
        return self._pack(Command(**self._to_autopilot(now_ns), command=number, params=params))

    def _to_autopilot(self, now_ns: int) -> dict[str, Any]:
        """Return the time and target fields of a record for the autopilot."""
        mine = self._autopilot
        target = (0, 0) if mine is None else (mine.system, mine.component)
        return {**stamp(now_ns), "target_system": target[0], "target_component": target[1]}

    def encode(self, message: Message) -> bytes:
        """Encode a message of ours as a frame. Call `connect` first."""
        return self._pack(message)

    def _pack(self, message: Message) -> bytes:
        assert self._us is not None  # noqa: S101 - connect() comes before anything is packed
        return self._us.encode(message)


def _pong(m: Ping, now_ns: int) -> Ping:
    """Answer a PING to its sender."""
    return Ping(
        **stamp(now_ns), time_us=m.time_us, number=m.number, target_system=m.system, target_component=m.component
    )
