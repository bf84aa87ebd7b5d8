"""The layout of MAVLink frames."""

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

V1: Final = 0xFE
V2: Final = 0xFD
V1_HEADER_SIZE: Final = 6
V2_HEADER_SIZE: Final = 10
CHECKSUM_SIZE: Final = 2
SIGNATURE_SIZE: Final = 13
SIGNED: Final = 0x01  # the only incompatibility flag there is; a frame with another cannot be read
# MAVLink's checksum (CRC-16/MCRF4XX) runs through the bits of each byte in the other order than `crc_hqx`.
MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
CURRENT_MODE_ID: Final = 436
TARGET_RELATIVE_ID: Final = 511  # of MAVLink's development.xml
# Messages that pymavlink's dialects lack: number, name, and CRC_EXTRA, with which the checksum begins.
UNLISTED: Final = {CURRENT_MODE_ID: ("CURRENT_MODE", 193), TARGET_RELATIVE_ID: ("TARGET_RELATIVE", 28)}
MESSAGES: Final = {n: (kind.msgname, kind.crc_extra) for n, kind in dialect.mavlink_map.items()} | UNLISTED


def parse_header(frame: bytes) -> tuple[int, int, int, int]:
    """Return the header's size, the message's number, and the sender's system and component."""
    if frame[0] == V1:
        return V1_HEADER_SIZE, frame[5], frame[3], frame[4]
    return V2_HEADER_SIZE, frame[7] | frame[8] << 8 | frame[9] << 16, frame[5], frame[6]


def frame_length(data: bytes, at: int) -> int | None:
    """Length of the frame that starts at `at`; None if there is none or its header is cut off."""
    if at + 3 > len(data):
        return None
    if data[at] == V1:
        return V1_HEADER_SIZE + data[at + 1] + CHECKSUM_SIZE
    if data[at] == V2:
        return V2_HEADER_SIZE + data[at + 1] + CHECKSUM_SIZE + (SIGNATURE_SIZE if data[at + 2] & SIGNED else 0)
    return None
