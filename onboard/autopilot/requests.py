"""Requests for our messages: REQUEST_MESSAGE, SET_MESSAGE_INTERVAL, GET_MESSAGE_INTERVAL.

Only trusted systems may change the interval of a message that an autopilot flies on.
"""

import math
from collections.abc import Callable, Collection
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard import __version__
from onboard.autopilot.stream import Stream
from onboard.config import MAX_OUT_RATE_HZ
from onboard.messages import Clock, Command, Message, MessageInterval, Version
from onboard.messages.causes import Cause, Reason
from onboard.wire.datagrams import OnRefused, ignore
from onboard.wire.mavlink.encode import message_number

STEERING: Final = (  # what an autopilot follows, fuses or avoids
    "SET_POSITION_TARGET_LOCAL_NED",
    *("FOLLOW_TARGET", "GLOBAL_POSITION_INT", "TARGET_RELATIVE", "LANDING_TARGET", "ADSB_VEHICLE"),
    *("COLLISION", "ODOMETRY"),
)
STEERING_NUMBERS: Final = {message_number(name): name for name in STEERING}
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3  # MAV_RESULT


class Answer(NamedTuple):
    """MAV_RESULT of a command, and the messages to send after its COMMAND_ACK."""

    result: int
    messages: tuple[Message, ...] = ()


class OfferedStream(NamedTuple):
    """A stream on a link, and whether a message could be sent now."""

    stream: Stream
    can_send: Callable[[], bool]


Make = Callable[[int], Message]  # from the time, ns on this computer's clock


class Requests:
    """Messages that may be requested: streams of each link, and messages made on request.

    `trusted`: systems that may change what an autopilot flies on."""

    def __init__(self, trusted: Collection[int] = (), refuse: OnRefused = ignore) -> None:
        self.lines: list[str] = []  # for a person: who changed which interval
        self._trusted = frozenset(trusted)
        self._refuse = refuse
        self._streams: dict[tuple[str, int], list[OfferedStream]] = {}
        self._single: dict[int, Make] = {}

    def clear_streams(self) -> None:
        """Forget all streams, before those for another autopilot are offered."""
        self._streams.clear()

    def offer_stream(self, channel: str, name: str, stream: Stream, can_send: Callable[[], bool]) -> None:
        """Register a message that is sent periodically on a link."""
        self._streams.setdefault((channel, message_number(name)), []).append(OfferedStream(stream, can_send))

    def offer(self, name: str, make: Make) -> None:
        """Register a message that is sent on request only, on any link."""
        self._single[message_number(name)] = make

    def answer(self, channel: str, command: Command, now_ns: int) -> Answer:
        """Answer a command; UNSUPPORTED if it is no request for a message of ours."""
        number = command.params[0]
        if command.command not in ANSWERED_COMMANDS or not (math.isfinite(number) and number == int(number)):
            return Answer(UNSUPPORTED)
        streams = self._streams.get((channel, int(number)), [])
        if command.command == dialect.MAV_CMD_REQUEST_MESSAGE:
            return self._request(int(number), streams, now_ns)
        if not streams:
            return Answer(UNSUPPORTED)
        if command.command == dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
            interval = MessageInterval(
                **stamp(now_ns), number=int(number), interval_us=streams[0].stream.interval_us
            )
            return Answer(ACCEPTED, (interval,))
        name = STEERING_NUMBERS.get(int(number))
        if name is not None and command.system not in self._trusted:
            why = Reason(Cause.UNTRUSTED, f"the interval of {name}: {UNTRUSTED}")
            self._refuse(sender_of(command), why, command.t_recv_ns)
            return Answer(DENIED)
        before = streams[0].stream.interval_us
        done = [offered.stream.set_interval(command.params[1], MAX_OUT_RATE_HZ) for offered in streams]
        if name is not None and streams[0].stream.interval_us != before:
            self.lines.append(f"{name} {_describe(streams[0].stream)} by {sender_of(command)}")
        return Answer(ACCEPTED if all(done) else DENIED)

    def _request(self, number: int, streams: list[OfferedStream], now_ns: int) -> Answer:
        if number in self._single:
            return Answer(ACCEPTED, (self._single[number](now_ns),))
        if not streams:
            return Answer(UNSUPPORTED)
        able = [offered for offered in streams if offered.can_send()]
        for offered in able:
            offered.stream.request()
        return Answer(ACCEPTED if able else TEMPORARILY_REJECTED)


ANSWERED_COMMANDS: Final = frozenset(
    {
        dialect.MAV_CMD_REQUEST_MESSAGE,
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
    }
)


UNTRUSTED: Final = "only systems of `autopilot.trusted` may change it"


def sender_of(message: Message) -> str:
    """Describe the sender of a message."""
    return f"system {message.system}, component {message.component}"


def _describe(stream: Stream) -> str:
    return f"at {1e6 / stream.interval_us:.3g} Hz" if stream.interval_us > 0 else "off"


def stamp(now_ns: int) -> dict[str, Any]:
    """Return the time fields of a record that we send."""
    return {"t_ns": now_ns, "t_recv_ns": now_ns, "clock": Clock.HOST}


def version(now_ns: int) -> Version:
    """Make AUTOPILOT_VERSION."""
    major, minor, patch = (int(part) for part in __version__.split(".")[:3])
    bits = (
        dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    )
    return Version(**stamp(now_ns), capabilities=bits, version=(major, minor, patch))
