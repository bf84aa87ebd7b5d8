"""Files that may be read over MAVLink FTP; none can be written. Sans-IO.

Each client has one session, number 0, with the file that it opened last: MAVSDK reads session 0 whatever number it
is given. An answer that is lost is made again on the same request.
"""

import struct
from collections.abc import Callable, Mapping
from typing import Final

from onboard.autopilot.requests import stamp
from onboard.messages import FileError, FileReply, FileRequest
from onboard.wire.mavlink.files import MOST_DATA, crc32

NOTHING, TERMINATE, RESET, LIST, OPEN, READ, CRC32, BURST = 0, 1, 2, 3, 4, 5, 14, 15  # opcodes
SESSION: Final = 0
MOST_IN_BURST: Final = 10  # answers to one request: half a second of a serial line at 57,600 Bd
MOST_CLIENTS: Final = 16  # with an open file; a further one closes that of the first


class RefusedError(Exception):
    """A request that is answered with an error."""

    def __init__(self, error: FileError) -> None:
        super().__init__(error.name)
        self.error = error


class Files:
    """A folder of files, by name."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = dict(files)
        self._opened: dict[tuple[int, int], bytes] = {}  # by client, that of the oldest session first
        self._answer: dict[int, Callable[[FileRequest], bytes]] = {
            NOTHING: lambda _: b"",
            TERMINATE: self._close,
            RESET: self._close,
            LIST: self._list,
            OPEN: self._open,
            READ: lambda m: self._read(m, m.offset),
            CRC32: lambda m: struct.pack("<I", crc32(self._find(m))),
        }

    def answer(self, m: FileRequest, now_ns: int) -> list[FileReply]:
        """What to send on a request."""
        if m.opcode != BURST and m.opcode not in self._answer:
            return [_reply(m, now_ns, error=FileError.UNKNOWN_COMMAND)]
        try:
            if m.opcode == BURST:
                return self._burst(m, now_ns)
            data = self._answer[m.opcode](m)
        except RefusedError as refused:
            return [_reply(m, now_ns, error=refused.error)]
        return [_reply(m, now_ns, data=data)]

    def _find(self, m: FileRequest) -> bytes:
        name = m.data.split(b"\0", 1)[0].decode("ascii", "replace").lstrip("/")
        if name not in self._files:
            raise RefusedError(FileError.NOT_FOUND)
        return self._files[name]

    def _open(self, m: FileRequest) -> bytes:
        file = self._find(m)
        self._close(m)
        if len(self._opened) >= MOST_CLIENTS:
            del self._opened[next(iter(self._opened))]
        self._opened[m.system, m.component] = file
        return struct.pack("<I", len(file))

    def _close(self, m: FileRequest) -> bytes:
        self._opened.pop((m.system, m.component), None)
        return b""

    def _file(self, m: FileRequest) -> bytes:
        file = self._opened.get((m.system, m.component))
        if m.session != SESSION or file is None:
            raise RefusedError(FileError.INVALID_SESSION)
        return file

    def _read(self, m: FileRequest, offset: int) -> bytes:
        data = self._file(m)[offset : offset + min(m.size or MOST_DATA, MOST_DATA)]
        if not data:
            raise RefusedError(FileError.END_OF_FILE)
        return data

    def _burst(self, m: FileRequest, now_ns: int) -> list[FileReply]:
        """Several pieces of the file; the last says so, and the client requests the rest."""
        replies: list[FileReply] = []
        offset, number = m.offset, m.number
        while not replies or not replies[-1].is_last:
            data = self._read(m, offset)
            number, end = number + 1, offset + len(data)
            is_last = end == len(self._file(m)) or len(replies) == MOST_IN_BURST - 1
            replies.append(_reply(m, now_ns, number=number, offset=offset, data=data, is_last=is_last))
            offset = end
        return replies

    def _list(self, m: FileRequest) -> bytes:
        """As many entries as fit, from number `offset` on."""
        if m.data.split(b"\0", 1)[0].strip(b"/.") != b"":
            raise RefusedError(FileError.NOT_FOUND)
        data = b""
        for name, content in list(self._files.items())[m.offset :]:
            entry = f"F{name}\t{len(content)}\0".encode("ascii")
            if len(data) + len(entry) <= MOST_DATA:
                data += entry
        if not data:
            raise RefusedError(FileError.END_OF_FILE)
        return data


def _reply(
    m: FileRequest,
    now_ns: int,
    *,
    number: int | None = None,
    offset: int | None = None,
    data: bytes = b"",
    error: FileError | None = None,
    is_last: bool = False,
) -> FileReply:
    return FileReply(
        **stamp(now_ns),
        target_system=m.system,
        target_component=m.component,
        number=(m.number + 1 if number is None else number) % 2**16,
        session=SESSION,
        opcode=m.opcode,
        offset=m.offset if offset is None else offset,
        data=data,
        error=error,
        is_last=is_last,
    )
