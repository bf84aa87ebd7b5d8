"""Recordings of MAVLink as ground stations write them (.tlog): 8 bytes of big-endian Unix microseconds, then
one frame, over and over."""

import io
import struct
from collections.abc import Iterator
from typing import BinaryIO, Final

from onboard.messages import Datagram, Encoding
from onboard.wire.mavlink.decode import flaw

STAMP: Final = struct.Struct(">Q")
MAGIC_V2: Final = 0xFD
MAGIC_V1: Final = 0xFE
SIGNED: Final = 0x01
TLOG_CHANNEL: Final = "tlog"
EARLIEST_US: Final = 0
READ_BYTES: Final = 1 << 20  # bytes that are read at a time
SEARCHED: Final = 1 << 16  # bytes in which a log that is damaged at its begin must show a frame that is whole
RECORD_MARGIN: Final = 1024  # bytes: more than a record, and what shows that it is whole
YEAR_2100_US: Final = 4_102_444_800_000_000  # the year 2100


class NotALogError(ValueError):
    """The file is no .tlog, nor one whose begin is damaged."""


def frame_length(data: bytes, at: int) -> int | None:
    """Length of the frame that starts at `at`; None if no frame does, or its header is cut off."""
    if at + 3 > len(data):
        return None
    if data[at] == MAGIC_V2:
        return 12 + data[at + 1] + (13 if data[at + 2] & SIGNED else 0)
    if data[at] == MAGIC_V1:
        return 8 + data[at + 1]
    return None


def read_tlog(source: bytes | BinaryIO, channel: str = TLOG_CHANNEL) -> Iterator[tuple[Datagram | None, int]]:
    """(Datagram, bytes consumed so far) for each record; (None, ...) once for each stretch without one. A file is
    read by blocks.

    Raises NotALogError at once when the first bytes are not a record, nor any of those that follow soon.
    """
    file = io.BytesIO(source) if isinstance(source, bytes) else source
    data, at, begin, lost = file.read(READ_BYTES), 0, 0, False  # `begin`: where the block is in the file
    t_us = _stamp_at(data, 0)
    if t_us is None and not _holds_record(data[:SEARCHED]):
        raise NotALogError("this is no .tlog: it does not begin with a time stamp and a MAVLink frame")
    while True:
        if len(data) - at < RECORD_MARGIN and (more := file.read(READ_BYTES)):
            data, at, begin = data[at:] + more, 0, begin + at
        if at + 8 >= len(data):
            break
        t_us = _stamp_at(data, at) if t_us is None else t_us
        length = None if t_us is None else frame_length(data, at + 8)
        end = at + 8 + (length or 0)
        next_us = None if length is None else _stamp_at(data, end)  # is found once: it begins the next record
        if t_us is None or length is None or not (next_us is not None or _is_whole(data, at + 8, end)):
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
    """Whether a frame that no record follows ends where its header says: the log ends there, or its checksum is
    right. A wrong length would eat the records behind it."""
    return end == len(data) or (end < len(data) and not flaw(data[start:end]))


def _holds_record(data: bytes) -> bool:
    """Whether there is a record whose frame has the right checksum."""
    for at in range(len(data) - 8):
        length = None if _stamp_at(data, at) is None else frame_length(data, at + 8)
        if length is None or at + 8 + length > len(data):
            continue
        if not flaw(data[at + 8 : at + 8 + length]):
            return True
    return False


def _stamp_at(data: bytes, at: int) -> int | None:
    """The time stamp of the record that starts at `at`, microseconds: a plausible one, followed by a frame's first
    byte; None if no record does."""
    if at + 9 > len(data) or data[at + 8] not in (MAGIC_V1, MAGIC_V2):
        return None
    t_us: int = STAMP.unpack_from(data, at)[0]
    return t_us if EARLIEST_US <= t_us < YEAR_2100_US else None


def tlog_record(t_recv_ns: int, frame: bytes) -> bytes:
    """The bytes of one record."""
    return STAMP.pack(t_recv_ns // 1000) + frame
