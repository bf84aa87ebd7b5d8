"""Ground stations' recordings of MAVLink (.tlog).

Each record is a big-endian 64-bit Unix time in microseconds and one frame.
"""

import io
import struct
from collections.abc import Iterator
from typing import BinaryIO, Final

from onboard.messages import Datagram, Encoding
from onboard.wire.mavlink.decode import frame_error
from onboard.wire.mavlink.frame import V1, V2, frame_length

STAMP: Final = struct.Struct(">Q")
TLOG_CHANNEL: Final = "tlog"
READ_BYTES: Final = 1 << 20  # bytes that are read at a time
MAX_SEARCH_BYTES: Final = 1 << 16  # in which a log that begins with damage must contain a whole frame
RECORD_MARGIN: Final = 1024  # bytes: more than a record, and what shows that it is whole
MAX_UNIX_TIME_US: Final = 4_102_444_800_000_000  # the year 2100


class NotALogError(ValueError):
    """The file is no .tlog, nor one whose begin is damaged."""


def read_tlog(source: bytes | BinaryIO, channel: str = TLOG_CHANNEL) -> Iterator[tuple[Datagram | None, int]]:
    """Read (Datagram, bytes consumed so far), (None, ...) for each stretch without a record.

    Raises NotALogError at once when neither the first bytes nor the next `MAX_SEARCH_BYTES` hold a record.
    """
    file = io.BytesIO(source) if isinstance(source, bytes) else source
    data, at, begin, lost = file.read(READ_BYTES), 0, 0, False  # `begin`: where the block is in the file
    t_us = _stamp_at(data, 0)
    if t_us is None and not _holds_record(data[:MAX_SEARCH_BYTES]):
        raise NotALogError("this is no .tlog: it does not begin with a time stamp and a MAVLink frame")
    while True:
        if len(data) - at < RECORD_MARGIN and (more := file.read(READ_BYTES)):
            data, at, begin = data[at:] + more, 0, begin + at
        if at + 8 >= len(data):
            break
        t_us = _stamp_at(data, at) if t_us is None else t_us
        size = None if t_us is None else frame_length(data, at + 8)
        end = at + 8 + (size or 0)
        next_us = None if size is None else _stamp_at(data, end)  # is found once: it begins the next record
        if t_us is None or size is None or not (next_us is not None or _is_whole(data, at + 8, end)):
            at, t_us = at + 1, None
            lost = True
            continue
        if lost:
            yield None, begin + at
            lost = False
        frame, t_ns = data[at + 8 : end], t_us * 1000
        at, t_us = end, next_us
        yield Datagram(channel=channel, encoding=Encoding.MAVLINK, t_recv_ns=t_ns, data=frame), begin + at
    if lost or at < len(data):
        yield None, begin + len(data)


def _is_whole(data: bytes, start: int, end: int) -> bool:
    """Whether a frame that no record follows is complete, by the log's end or the checksum."""
    return end == len(data) or (end < len(data) and not frame_error(data[start:end]))


def _holds_record(data: bytes) -> bool:
    """Whether there is a record whose frame has the right checksum."""
    for at in range(len(data) - 8):
        size = None if _stamp_at(data, at) is None else frame_length(data, at + 8)
        if size is not None and at + 8 + size <= len(data) and not frame_error(data[at + 8 : at + 8 + size]):
            return True
    return False


def _stamp_at(data: bytes, at: int) -> int | None:
    """The plausible time stamp, us, of the record that starts at `at`; None without a record."""
    if at + 9 > len(data) or data[at + 8] not in (V1, V2):
        return None
    t_us: int = STAMP.unpack_from(data, at)[0]
    return t_us if 0 <= t_us < MAX_UNIX_TIME_US else None


def tlog_record(t_recv_ns: int, frame: bytes) -> bytes:
    """The bytes of one record."""
    return STAMP.pack(t_recv_ns // 1000) + frame
