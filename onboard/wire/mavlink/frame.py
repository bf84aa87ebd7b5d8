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
# Not in pymavlink's dialects: number, and the byte that the checksum is seeded with.
TARGET_RELATIVE: Final = 511  # of MAVLink's development.xml
UNLISTED_EXTRA: Final = {TARGET_RELATIVE: 28}
