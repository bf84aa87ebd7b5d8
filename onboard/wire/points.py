"""Camera points as JSON <-> TargetPoints: pixels and intrinsics outside, image points inside."""

import math
import re
from typing import Final

import msgspec

from onboard.messages import CameraPoints, Intrinsics, Pixel, TargetPoints
from onboard.wire.document import BadDocumentError, check_name, parse

TARGET: Final = re.compile(r"(?=.{0,64}$)([A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*)?")  # part of a key to publish under

_decoder = msgspec.json.Decoder(CameraPoints)


def decode_points(data: bytes, t_recv_ns: int) -> TargetPoints:
    """TargetPoints of one JSON document of CameraPoints: image points in focal lengths, right and down positive.

    Raises BadDocumentError (see `document.parse`), also when a focal length is not positive or the target cannot
    be part of a key.
    """
    m = parse(_decoder, data)
    check_name(m.camera, "camera")
    k = m.intrinsics
    if not (k.fx_px > 0 and k.fy_px > 0):
        raise BadDocumentError("focal lengths must be positive - at `$.intrinsics`")
    if not TARGET.fullmatch(m.target):
        raise BadDocumentError("letters, digits and -_. with / between, 64 at most - at `$.target`")
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
        view=_view(k),
        sigma=None if None in sigmas else tuple(s / f_px for s in sigmas if s is not None),  # type: ignore[arg-type]  # three of three
    )


def _view(k: Intrinsics) -> tuple[float, float, float, float] | None:
    """Left, upper, right and lower edge of the image, in focal lengths; None where they are not known."""
    width, height = 2 * k.cx_px, 2 * k.cy_px
    if k.width_px is not None and k.height_px is not None:
        width, height = k.width_px, k.height_px
        if not (width > 0 and height > 0):
            raise BadDocumentError("width and height must be positive - at `$.intrinsics`")
    elif min(width, height) <= 0:
        return None
    return -k.cx_px / k.fx_px, -k.cy_px / k.fy_px, (width - k.cx_px) / k.fx_px, (height - k.cy_px) / k.fy_px


def encode_points(message: CameraPoints) -> bytes:
    """JSON of one image's points."""
    return msgspec.json.encode(message)
