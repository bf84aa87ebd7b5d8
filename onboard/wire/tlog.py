"""Recordings of MAVLink as ground stations write them (.tlog): 8 bytes of big-endian Unix microseconds, then
one frame, over and over."""

import io
import struct
from collections.abc import Iterator
from typing import BinaryIO, Final

from onboard.messages import Datagram, Encoding
from onboard.wire.mavlink_decode import flaw

MAGIC_V2: Final = 0xFD
MAGIC_V1: Final = 0xFE
SIGNED: Final = 0x01
CHANNEL: Final = "tlog"
EARLIEST_US: Final = 0
BLOCK: Final = 1 << 20  # bytes that are read at a time
SEARCHED: Final = 1 << 16  # bytes in which a log that is damaged at its begin must show a frame that is whole
MARGIN: Final = 1024  # bytes: more than a record, and what shows that it is whole
LATEST_US: Final = 4_102_444_800_000_000  # the year 2100


class NotALogError(ValueError):
    """The file is no .tlog, nor one whose begin is damaged."""


def frame_length(data: memoryview, at: int) -> int | None:
    """Length of the frame that starts at `at`; None if no frame does, or its header is cut off."""
    if at + 3 > len(data):
        return None
    if data[at] == MAGIC_V2:
        return 12 + data[at + 1] + (13 if data[at + 2] & SIGNED else 0)
    if data[at] == MAGIC_V1:
        return 8 + data[at + 1]
    return None


def read_tlog(source: bytes | BinaryIO, channel: str = CHANNEL) -> Iterator[tuple[Datagram | None, int]]:
    """(Datagram, bytes consumed so far) for each record; (None, ...) once for each stretch without one. A file is
    read by blocks.

    Raises NotALogError at once when the first bytes are not a record, nor any of those that follow soon.
    """
    file = io.BytesIO(source) if isinstance(source, bytes) else source
    view, at, begin, lost = memoryview(file.read(BLOCK)), 0, 0, False  # `begin`: where the view is in the file
    if not _record_at(view, 0) and not _holds_record(view[:SEARCHED]):
        raise NotALogError("this is no .tlog: it does not begin with a time stamp and a MAVLink frame")
    while True:
        if len(view) - at < MARGIN and (more := file.read(BLOCK)):
            view, at, begin = memoryview(bytes(view[at:]) + more), 0, begin + at
        if at + 8 >= len(view):
            break
        length = frame_length(view, at + 8) if _record_at(view, at) else None
        if length is None or not _is_whole(view, at + 8, at + 8 + length):
            at += 1
            lost = True
            continue
        if lost:
            yield None, begin + at
            lost = False
        (t_us,) = struct.unpack_from(">Q", view, at)
        frame = bytes(view[at + 8 : at + 8 + length])
        at += 8 + length
        yield Datagram(channel=channel, encoding=Encoding.MAVLINK, t_recv_ns=t_us * 1000, data=frame), begin + at
    if lost or at < len(view):
        yield None, begin + len(view)


def _is_whole(view: memoryview, start: int, end: int) -> bool:
    """Whether a frame ends where its header says: a record follows, or its checksum is right. A wrong length would
    eat the records behind it."""
    return end == len(view) or _record_at(view, end) or (end < len(view) and not flaw(bytes(view[start:end])))


def _holds_record(view: memoryview) -> bool:
    """Whether there is a record whose frame has the right checksum."""
    for at in range(len(view) - 8):
        length = frame_length(view, at + 8) if _record_at(view, at) else None
        if length is not None and not flaw(bytes(view[at + 8 : at + 8 + length])):
            return True
    return False


def _record_at(view: memoryview, at: int) -> bool:
    """Whether a plausible time stamp starts at `at`, followed by a frame's first byte."""
    if at + 9 > len(view) or view[at + 8] not in (MAGIC_V1, MAGIC_V2):
        return False
    (t_us,) = struct.unpack_from(">Q", view, at)
    return bool(EARLIEST_US <= t_us < LATEST_US)


def tlog_record(t_recv_ns: int, frame: bytes) -> bytes:
    """The bytes of one record."""
    return struct.pack(">Q", t_recv_ns // 1000) + frame
