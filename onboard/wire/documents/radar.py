"""Radar detections as JSON -> RadarScan."""

import math
from typing import Final

import msgspec

from onboard.messages import RadarDetection, RadarDetections, RadarScan
from onboard.wire.documents.document import BadDocumentError, Refuse, check_name, parse_measurements, raise_reason

POSSIBLE_ECHOES: Final = "range > 0, azimuth within +-2 pi, elevation within +-pi/2, sigma > 0"
MAX_ECHO_COUNT: Final = 4096  # in one scan; no radar of a small aircraft resolves more

_decoder = msgspec.json.Decoder(RadarDetections)


def decode_radar(data: bytes, t_recv_ns: int, refuse: Refuse = raise_reason) -> RadarScan:
    """Decode one JSON document of RadarDetections; `refuse` is called for each bad echo.

    Raises BadDocumentError (see `document.parse`), also when no echo of several can be used: an empty scan would
    claim that the radar sees nothing.
    """
    m = parse_measurements(_decoder, data, _possible, POSSIBLE_ECHOES, refuse)
    check_name(m.radar, "radar")
    if len(m.detections) > MAX_ECHO_COUNT:
        raise BadDocumentError(f"more than {MAX_ECHO_COUNT} detections - at `$.detections`")
    return RadarScan(
        t_ns=m.t_ns,
        t_recv_ns=t_recv_ns,
        clock=m.clock,
        system=0,
        component=0,
        radar=m.radar,
        frame=m.frame,
        detections=m.detections,
    )


def _possible(d: RadarDetection) -> bool:
    return (
        0 < d.range < 1e7
        and abs(d.azimuth) <= 2 * math.pi
        and abs(d.elevation) <= math.pi / 2
        and (d.sigma is None or all(0 < s < 1e6 for s in d.sigma))
    )
