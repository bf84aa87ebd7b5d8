"""MAVLink bytes -> records in SI units. Sans-IO: bytes in, messages out; bad bytes are counted, not raised.

Two framings. UDP: every datagram stands alone, so the parser is cleared first and a truncated datagram cannot
eat the next. Streams (TCP, serial): the parser keeps the cut frame, and its consumed part is trimmed because
pymavlink never does while reads end mid-frame.
"""

from collections import Counter
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Message
from onboard.wire.landing_target import PointAssembler
from onboard.wire.mavlink_records import CONVERT, read_header

TRIM_BYTES: Final = 4096


class MavlinkDecoder:
    """Decoder of one channel. `rejected` counts by reason the bytes and frames that gave no message; `names`
    counts every well-formed frame by its MAVLink name."""

    def __init__(self, *, stream: bool) -> None:
        self.rejected: Counter[str] = Counter()
        self.names: Counter[str] = Counter()
        self._stream = stream
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._points = PointAssembler(self.rejected)

    def decode(self, data: bytes, t_recv_ns: int) -> list[Message]:
        """Messages in `data`, in order. `t_recv_ns` is when the bytes arrived."""
        parser = self._parser
        if not self._stream:
            parser.buf = bytearray()
            parser.buf_index = 0
            parser.expected_length = 8
        messages = []
        for frame in parser.parse_buffer(data) or ():
            message = self._message(frame, t_recv_ns)
            if message is not None:
                messages.append(message)
        if parser.buf_index > TRIM_BYTES:
            del parser.buf[: parser.buf_index]
            parser.buf_index = 0
        if not self._stream and len(parser.buf) > parser.buf_index:
            self.rejected["truncated"] += 1
        return messages

    def _message(self, frame: Any, t_recv_ns: int) -> Message | None:
        name = frame.get_type()
        if name == "BAD_DATA":
            self.rejected["bad_frame"] += 1
            return None
        if name.startswith("UNKNOWN_"):
            self.rejected["unknown_message"] += 1  # pymavlink passes these on without a checksum test
            return None
        self.names[name] += 1
        if name == "LANDING_TARGET":
            return self._points.add(frame, t_recv_ns)
        convert = CONVERT.get(name)
        return None if convert is None else convert(frame, read_header(frame, t_recv_ns))
