"""Which datagrams a link may leave out where more come than there is time for."""

from typing import Final

from onboard.wire.mavlink.frame import CHECKSUM, SIGNATURE, SIGNED, V1, V1_HEAD, V2, V2_HEAD

NEEDED: Final = 0
OF_IMU: Final = 1  # the next sample says nearly the same
OF_OTHERS: Final = 2  # another aircraft's report, which comes again
SURPLUS_KINDS: Final = {26: OF_IMU, 27: OF_IMU, 105: OF_IMU, 116: OF_IMU, 129: OF_IMU, 246: OF_OTHERS}  # by number


def surplus(data: bytes) -> int:
    """How readily a datagram is left out: NEEDED, never. One of several frames is needed, whatever is in it."""
    if len(data) < V1_HEAD:
        return NEEDED
    if data[0] == V2 and len(data) >= V2_HEAD:
        size = V2_HEAD + data[1] + CHECKSUM + (SIGNATURE if data[2] & SIGNED else 0)
        number = int.from_bytes(data[7:10], "little")
    elif data[0] == V1:
        size, number = V1_HEAD + data[1] + CHECKSUM, data[5]
    else:
        return NEEDED
    return SURPLUS_KINDS.get(number, NEEDED) if len(data) == size else NEEDED
