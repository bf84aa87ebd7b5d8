"""MAVLink frames packed by hand, decoded by us and by pymavlink's parser."""

import struct
from typing import Any, Final

from pymavlink.dialects.v20 import common

from onboard.messages import Message
from onboard.wire.mavlink.decode import MavlinkDecoder
from tests.support.images import detections

RECEIVE_TIME_NS: Final = 1_735_689_605_000_000_000
# LOCAL_POSITION_NED of system 3, component 1.
NED_V2: Final = "fd1c000007030120000040e201000000c03f000010c00000f4c10000003e000000bf000080401edb"
NED_V1: Final = "fe1c0703012040e201000000c03f000010c00000f4c10000003e000000bf000080406547"


def crc_x25(data: bytes) -> int:
    """CRC-16/MCRF4XX, computed as the protocol describes it."""
    crc = 0xFFFF
    for byte in data:
        t = byte ^ (crc & 0xFF)
        t ^= (t << 4) & 0xFF
        crc = ((crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4)) & 0xFFFF
    return crc


def frame(
    number: int, extra: int, payload: bytes, *, version: int = 2, system: int = 1, component: int = 1
) -> bytes:
    """A frame packed by hand, after the protocol's own description."""
    if version == 1:
        head = struct.pack("<BBBBB", len(payload), 0, system, component, number)
        magic = b"\xfe"
    else:
        payload = payload.rstrip(b"\0") or b"\0"
        head = struct.pack("<BBBBBB", len(payload), 0, 0, 0, system, component) + number.to_bytes(3, "little")
        magic = b"\xfd"
    return magic + head + payload + struct.pack("<H", crc_x25(head + payload + bytes([extra])))


def decode(data: bytes, *, stream: bool = False) -> list[Message]:
    """The messages that a new decoder reads, received at RECV."""
    return MavlinkDecoder(stream=stream).decode(data, RECEIVE_TIME_NS)


def one(data: bytes) -> Any:
    """The only message in these bytes."""
    (message,) = detections(decode(data))
    return message


def independent(data: bytes) -> list[Any]:
    """The messages that pymavlink's parser of the common dialect reads."""
    parser = common.MAVLink(None)
    return parser.parse_buffer(data) or []
