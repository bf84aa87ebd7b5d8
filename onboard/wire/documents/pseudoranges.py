"""Pseudoranges as JSON -> PeerRanges."""

import math
from typing import Final

import msgspec

from onboard.messages import PeerRanges, Pseudoranges, SatelliteRange
from onboard.wire.documents.document import BadDocumentError, Refuse, parse_measurements, raise_reason

MAX_SATELLITE_COUNT: Final = 64  # no receiver tracks more of one constellation
ORBITS: Final = (6.4e6, 1e8)  # m from the Earth's centre
FASTEST_RANGE_RATE: Final = 2e4  # m/s
MAX_RANGE_M: Final = 1e9  # pseudoranges contain the error of the receiver's clock
POSSIBLE_ORBITS: Final = (
    "orbits are 6400 to 100000 km from the Earth's centre, pseudoranges to 1e9 m, rates and "
    "velocities to 20 km/s, sigma > 0"
)

_decoder = msgspec.json.Decoder(Pseudoranges)


def decode_ranges(data: bytes, t_recv_ns: int, refuse: Refuse = raise_reason) -> PeerRanges:
    """Decode one JSON document of Pseudoranges; `refuse` is called for each bad satellite.

    Raises BadDocumentError (see `document.parse`), also when no satellite can be used, or one occurs twice.
    """
    m = parse_measurements(_decoder, data, _possible, POSSIBLE_ORBITS, refuse)
    if not 1 <= m.peer <= 255:
        raise BadDocumentError("a system number is 1 to 255 - at `$.peer`")
    if len(m.satellites) > MAX_SATELLITE_COUNT or len({s.satellite for s in m.satellites}) < len(m.satellites):
        raise BadDocumentError(f"at most {MAX_SATELLITE_COUNT} satellites, each once - at `$.satellites`")
    return PeerRanges(
        t_ns=m.t_ns,
        t_recv_ns=t_recv_ns,
        clock=m.clock,
        system=0,
        component=0,
        peer=m.peer,
        satellites=m.satellites,
    )


def _possible(s: SatelliteRange) -> bool:
    low, high = ORBITS
    return (
        low < math.hypot(*s.r_e) < high
        and math.hypot(*s.v_e) < FASTEST_RANGE_RATE
        and abs(s.pseudorange) < MAX_RANGE_M
        and abs(s.rate) < FASTEST_RANGE_RATE
        and all(sigma is None or 0 < sigma < 1e6 for sigma in (s.sigma, s.rate_sigma))
    )
