"""Camera points as JSON <-> TargetPoints: pixels and intrinsics on the outside, image points inside."""

import math
import re
from typing import Final

import msgspec

from onboard.messages import CameraPoints, Pixel, TargetPoints

LATEST_NS: Final = 2**63
TARGET: Final = re.compile(r"(?=.{0,64}$)([A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*)?")  # part of a key to publish under

_decoder = msgspec.json.Decoder(CameraPoints)


class BadPointsError(ValueError):
    """JSON that is no CameraPoints; the message names the field."""


def decode_points(data: bytes, t_recv_ns: int) -> TargetPoints:
    """TargetPoints of one JSON document.

    Raises BadPointsError when it is no JSON, a field is missing, unknown or of the wrong type, a focal
    length is not positive, the time not of 64 bits, or the target no part of a key.
    """
    try:
        m = _decoder.decode(data)
    except msgspec.DecodeError as error:  # ValidationError is one too
        raise BadPointsError(str(error)) from error
    k = m.intrinsics
    if not (k.fx_px > 0 and k.fy_px > 0):
        raise BadPointsError("focal lengths must be positive - at `$.intrinsics`")
    if not -LATEST_NS < m.t_ns < LATEST_NS:
        raise BadPointsError("a time is of 64 bits - at `$.t_ns`")
    if not TARGET.fullmatch(m.target):
        raise BadPointsError("letters, digits and -_. with / between, 64 at most - at `$.target`")
    sigmas = (m.center.sigma_px, m.left.sigma_px, m.right.sigma_px)
    f_px = math.sqrt(k.fx_px) * math.sqrt(k.fy_px)

    def point(p: Pixel) -> tuple[float, float]:
        return (p.u_px - k.cx_px) / k.fx_px, (p.v_px - k.cy_px) / k.fy_px

    return TargetPoints(
        t_ns=m.t_ns,
        t_recv_ns=t_recv_ns,
        clock=m.clock,
        system=0,
        component=0,
        camera=m.camera,
        target=m.target,
        center=point(m.center),
        left=point(m.left),
        right=point(m.right),
        half_view=(k.cx_px / k.fx_px, k.cy_px / k.fy_px) if min(k.cx_px, k.cy_px) > 0 else None,
        sigma=None if None in sigmas else tuple(s / f_px for s in sigmas if s is not None),  # type: ignore[arg-type]  # three of three
    )


def encode_points(message: CameraPoints) -> bytes:
    """JSON of one image's points."""
    return msgspec.json.encode(message)
