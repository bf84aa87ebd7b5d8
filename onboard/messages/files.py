"""Files over MAVLink FTP, and where a component's metadata is."""

from enum import IntEnum

from onboard.messages.base import Message


class FileError(IntEnum):
    """Why a request is refused, by its number in MAVLink FTP."""

    INVALID_SESSION = 4
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    NOT_FOUND = 10


class FileRequest(Message, frozen=True, kw_only=True):
    """FILE_TRANSFER_PROTOCOL from a client. `number` is its sequence number; `size` is that of its data, or that
    of the answer to a request to read."""

    target_system: int
    target_component: int
    number: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes


class FileReply(Message, frozen=True, kw_only=True):
    """FILE_TRANSFER_PROTOCOL from the server: the answer to a request of `opcode`. `is_last`: of several answers
    to one request."""

    target_system: int
    target_component: int
    number: int
    session: int
    opcode: int
    offset: int
    data: bytes = b""
    error: FileError | None = None
    is_last: bool = False


class ComponentMetadata(Message, frozen=True, kw_only=True):
    """COMPONENT_METADATA: where the file of general metadata is, and its CRC-32 as MAVLink FTP has it."""

    uri: str
    crc: int
