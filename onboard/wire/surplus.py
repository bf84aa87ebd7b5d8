"""Which datagrams a link may leave out where more come than there is time for."""

from typing import Final

from onboard.wire.mavlink.frame import V1_HEADER_SIZE, frame_length, parse_header

NEEDED_RANK: Final = 0  # never left out
IMU_RANK: Final = 1  # the next sample contains nearly the same
TRAFFIC_RANK: Final = 2  # reports of another aircraft, which are repeated
SURPLUS_KINDS: Final = {**dict.fromkeys((26, 27, 105, 116, 129), IMU_RANK), 246: TRAFFIC_RANK}  # by number


def surplus(data: bytes) -> int:
    """The rank of a datagram for omission; a datagram with several frames is needed."""
    if len(data) < V1_HEADER_SIZE or frame_length(data, 0) != len(data):
        return NEEDED_RANK
    return SURPLUS_KINDS.get(parse_header(data)[1], NEEDED_RANK)
