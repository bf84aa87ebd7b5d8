"""Radar detections as JSON <-> RadarScan."""

import math
from typing import Final

import msgspec

from onboard.messages import RadarDetection, RadarDetections, RadarScan

LATEST_NS: Final = 2**63
MOST: Final = 4096  # detections in one scan; no radar of a small aircraft tells more apart

_decoder = msgspec.json.Decoder(RadarDetections)


class BadRadarError(ValueError):
    """JSON that is no RadarDetections; the message names the field."""


def decode_radar(data: bytes, t_recv_ns: int) -> RadarScan:
    """RadarScan of one JSON document.

    Raises BadRadarError when it is no JSON, a field is missing, unknown or of the wrong type, a number out of its
    range, or the time not of 64 bits.
    """
    try:
        m = _decoder.decode(data)
    except msgspec.DecodeError as error:  # ValidationError is one too
        raise BadRadarError(str(error)) from error
    if not -LATEST_NS < m.t_ns < LATEST_NS:
        raise BadRadarError("a time is of 64 bits - at `$.t_ns`")
    if len(m.detections) > MOST:
        raise BadRadarError(f"more than {MOST} detections - at `$.detections`")
    for i, detection in enumerate(m.detections):
        if not _possible(detection):
            raise BadRadarError(
                f"range > 0, azimuth within +-2 pi, elevation within +-pi/2, sigma > 0 - at `$.detections[{i}]`"
            )
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


def encode_radar(message: RadarDetections) -> bytes:
    """JSON of one scan."""
    return msgspec.json.encode(message)


def _possible(d: RadarDetection) -> bool:
    return (
        0 < d.range < 1e7
        and abs(d.azimuth) <= 2 * math.pi
        and abs(d.elevation) <= math.pi / 2
        and (d.sigma is None or all(0 < s < 1e6 for s in d.sigma))
    )
