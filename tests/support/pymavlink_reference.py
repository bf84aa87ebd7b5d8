"""Decodes MAVLink by pymavlink's own parser, to hold our decoder to: messages and counts."""

from collections import Counter
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Clock, Message
from tests.support.pymavlink_protocols import PROTOCOLS
from tests.support.pymavlink_records import RECORDS

CONVERT: Final = RECORDS | PROTOCOLS
MIN_UNIX_TIME_NS: Final = 10**18  # a smaller 64-bit stamp is time since boot, not Unix time (2001)


def read_header(frame: Any, t_recv_ns: int) -> dict[str, Any]:
    """The fields that every record has.

    The stamp comes from whichever time field the message has; without one the message is taken as true when it
    arrived.
    """
    t_ns, clock = t_recv_ns, Clock.NONE
    if hasattr(frame, "time_boot_ms"):
        t_ns, clock = frame.time_boot_ms * 1_000_000, Clock.BOOT
    elif hasattr(frame, "time_usec") and frame.time_usec > 0:
        t_ns = frame.time_usec * 1000
        clock = Clock.HOST if t_ns >= MIN_UNIX_TIME_NS else Clock.BOOT
    return {
        "t_ns": t_ns,
        "t_recv_ns": t_recv_ns,
        "clock": clock,
        "system": frame.get_srcSystem(),
        "component": frame.get_srcComponent(),
    }


class Reference:
    """A reference for `onboard.wire.mavlink.decode.MavlinkDecoder`: messages, `names`, `rejected`."""

    def __init__(self, *, stream: bool) -> None:
        self.rejected: Counter[str] = Counter()
        self.names: Counter[str] = Counter()
        self._stream = stream
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True

    def decode(self, data: bytes, t_recv_ns: int) -> list[Message]:
        parser = self._parser
        if not self._stream:
            parser.buf, parser.buf_index, parser.expected_length = bytearray(), 0, 8
        frames = parser.parse_buffer(data) or ()
        if not self._stream and len(parser.buf) > parser.buf_index:
            self.rejected["truncated"] += 1
        del parser.buf[: parser.buf_index]
        parser.buf_index = 0
        messages = [self._message(frame, t_recv_ns) for frame in frames]
        return [m for m in messages if m is not None]

    def _message(self, frame: Any, t_recv_ns: int) -> Message | None:
        name = frame.get_type()
        if name == "BAD_DATA":
            self.rejected["bad_frame"] += 1
            return None
        if name.startswith("UNKNOWN_"):
            self.rejected["unknown_message"] += 1
            return None
        self.names[name] += 1
        convert = CONVERT.get(name)
        return None if convert is None else convert(frame, read_header(frame, t_recv_ns))
