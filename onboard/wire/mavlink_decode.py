"""MAVLink bytes -> records in SI units. Sans-IO: bytes in, messages out; bad bytes are counted, not raised.

Two framings. UDP: every datagram stands alone, so the parser is cleared first and a truncated datagram cannot
eat the next. Streams (TCP, serial): the parser keeps the cut frame, and its consumed part is trimmed because
pymavlink never does while reads end mid-frame.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Message
from onboard.wire.landing_target import PointAssembler
from onboard.wire.mavlink_records import CONVERT, read_header

TRIM_BYTES: Final = 4096
OnError = Callable[[str, Exception], None]


def raise_error(_place: str, error: Exception) -> None:
    """Raise an exception over one frame, where nobody counts it."""
    raise error


class MavlinkDecoder:
    """Decoder of one channel. `rejected` counts by reason the bytes and frames that gave no message; `names`
    counts every well-formed frame by its MAVLink name. `on_error` is called with a frame's name and the exception
    that it caused; the other frames are decoded."""

    def __init__(self, *, stream: bool, on_error: OnError = raise_error) -> None:
        self.rejected: Counter[str] = Counter()
        self.names: Counter[str] = Counter()
        self._stream = stream
        self._on_error = on_error
        self._parser = _new_parser()
        self._points = PointAssembler(self.rejected)

    def decode(self, data: bytes, t_recv_ns: int) -> list[Message]:
        """Messages in `data`, in order. `t_recv_ns` is when the bytes arrived."""
        parser = self._parser
        if not self._stream:
            parser.buf = bytearray()
            parser.buf_index = 0
            parser.expected_length = 8
        messages = []
        try:
            frames = parser.parse_buffer(data) or ()
        except Exception as error:  # of any kind: the parser may be stuck, so it starts again
            self._parser = _new_parser()
            self._on_error("mavlink", error)
            return []
        for frame in frames:
            try:
                message = self._message(frame, t_recv_ns)
            except Exception as error:  # of any kind: it costs this frame
                self._on_error(frame.get_type(), error)
                continue
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


def _new_parser() -> Any:
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    return parser
