"""The layout of MAVLink frames."""

from typing import Final

V1: Final = 0xFE
V2: Final = 0xFD
V1_HEAD: Final = 6
V2_HEAD: Final = 10
CHECKSUM: Final = 2
SIGNATURE: Final = 13
SIGNED: Final = 0x01  # the only incompatibility flag there is; a frame with another cannot be read
# MAVLink's checksum (CRC-16/MCRF4XX) runs through the bits of each byte in the other order than `crc_hqx`.
MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
CURRENT_MODE: Final = 436
TARGET_RELATIVE: Final = 511  # of MAVLink's development.xml
# Messages that pymavlink's dialects lack: number, name, and CRC_EXTRA, with which the checksum begins.
UNLISTED: Final = {CURRENT_MODE: ("CURRENT_MODE", 193), TARGET_RELATIVE: ("TARGET_RELATIVE", 28)}


def head_of(frame: bytes) -> tuple[int, int, int, int]:
    """What the head of a frame says: its own length, the message's number, the sender's system and component."""
    if frame[0] == V1:
        return V1_HEAD, frame[5], frame[3], frame[4]
    return V2_HEAD, frame[7] | frame[8] << 8 | frame[9] << 16, frame[5], frame[6]


def frame_length(data: bytes, at: int) -> int | None:
    """Length of the frame that starts at `at`, by its head; None if no frame does, or that is cut off."""
    if at + 3 > len(data):
        return None
    if data[at] == V1:
        return V1_HEAD + data[at + 1] + CHECKSUM
    if data[at] == V2:
        return V2_HEAD + data[at + 1] + CHECKSUM + (SIGNATURE if data[at + 2] & SIGNED else 0)
    return None
