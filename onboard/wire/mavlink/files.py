"""MAVLink FTP and COMPONENT_METADATA (397): MAVLink messages <-> records.

COMPONENT_METADATA is not in pymavlink's dialects. Its layout and CRC_EXTRA follow its definition in MAVLink's
common.xml.
"""

import struct
import zlib
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import ComponentMetadata, FileReply, FileRequest, Message
from onboard.wire.mavlink.frame import COMPONENT_METADATA
from onboard.wire.mavlink.unlisted import UnlistedMessage

HEAD: Final = struct.Struct("<H6BI")  # number, session, opcode, size, opcode of the request, is last, 0, offset
MOST_DATA: Final = 239  # bytes in one message
ACK, NAK = 128, 129


class ComponentMetadataMessage(UnlistedMessage):
    """COMPONENT_METADATA."""

    id = COMPONENT_METADATA
    msgname = "COMPONENT_METADATA"
    layout = struct.Struct("<2I100s")  # time_boot_ms, file_crc, uri


def crc32(data: bytes) -> int:
    """CRC-32 as MAVLink FTP has it: with neither the start nor the end inverted."""
    return zlib.crc32(data, 0xFFFF_FFFF) ^ 0xFFFF_FFFF


def _request(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    _, system, component, *payload = f
    number, session, opcode, size, _, _, _, offset = HEAD.unpack_from(bytes(payload))
    return FileRequest(
        **h,
        target_system=system,
        target_component=component,
        number=number,
        session=session,
        opcode=opcode,
        size=size,
        offset=offset,
        data=bytes(payload[HEAD.size :])[:size],
    )


def _reply(m: Any) -> list[Any]:
    data = m.data if m.error is None else bytes([m.error])
    opcode = ACK if m.error is None else NAK
    head = HEAD.pack(m.number, m.session, opcode, len(data), m.opcode, m.is_last, 0, m.offset)
    payload = (head + data).ljust(HEAD.size + MOST_DATA, b"\0")
    return [
        dialect.MAVLink_file_transfer_protocol_message(0, m.target_system, m.target_component, list(payload)),
    ]


# by name: the layout of the payload, and what reads it
CONVERT: Final[dict[str, tuple[str, Callable[[tuple[Any, ...], dict[str, Any]], Message | None]]]] = {
    "FILE_TRANSFER_PROTOCOL": ("<3B251B", _request),
}
ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {
    FileReply: _reply,
    ComponentMetadata: lambda m: [
        ComponentMetadataMessage(m.t_ns // 1_000_000 % 2**32, m.crc, m.uri.encode("ascii")),
    ],
}
