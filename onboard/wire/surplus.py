"""Which datagrams a link may leave out where more come than there is time for."""

from typing import Final

from onboard.wire.mavlink.frame import V1_HEAD, frame_length, head_of

NEEDED: Final = 0
OF_IMU: Final = 1  # the next sample says nearly the same
OF_OTHERS: Final = 2  # another aircraft's report, which comes again
SURPLUS_KINDS: Final = {26: OF_IMU, 27: OF_IMU, 105: OF_IMU, 116: OF_IMU, 129: OF_IMU, 246: OF_OTHERS}  # by number


def surplus(data: bytes) -> int:
    """How readily a datagram is left out: NEEDED, never. One of several frames is needed, whatever is in it."""
    if len(data) < V1_HEAD or frame_length(data, 0) != len(data):
        return NEEDED
    return SURPLUS_KINDS.get(head_of(data)[1], NEEDED)
