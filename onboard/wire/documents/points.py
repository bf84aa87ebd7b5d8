"""JSON CameraPoints -> TargetPoints, from pixels and intrinsics to image points."""

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import msgspec

from onboard.geometry.lens import Lens
from onboard.messages import CameraPoints, Exposure, Intrinsics, Pixel, TargetPoints
from onboard.messages.causes import Cause, Reason
from onboard.wire.documents.document import BadDocumentError, check_name, parse

TARGET: Final = re.compile(r"(?=.{0,64}$)([A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*)?")  # part of a key to publish under

_decoder = msgspec.json.Decoder(CameraPoints)


def decode_points(data: bytes, t_recv_ns: int) -> Exposure:
    """Decode one JSON document of CameraPoints to image points in focal lengths.

    Raises BadDocumentError (see `document.parse`), also when a focal length is not positive or the target cannot
    be part of a key.
    """
    m = parse(_decoder, data)
    check_name(m.camera, "camera")
    lens = lens_of(m.intrinsics)
    check_target(m.target, "target")
    sigmas = (m.center.sigma_px, m.left.sigma_px, m.right.sigma_px)

    check_pixels([x for p in (m.center, m.left, m.right) for x in (p.u_px, p.v_px)], "center")

    def point(p: Pixel) -> tuple[float, float]:
        return lens.image_point(p.u_px, p.v_px)

    image = TargetPoints(
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
        view=lens.view,
        doubt=doubt_of(lens) if lens.note else None,
        sigma=None if None in sigmas else tuple(s / lens.f_px for s in sigmas if s is not None),  # type: ignore[arg-type]  # three of three
    )
    return Exposure.of(image)


def doubt_of(lens: Lens) -> Reason:
    """The reason to doubt a camera's intrinsics, by the note of its lens."""
    return Reason(Cause.OFF_CENTER if lens.binning == 1 else Cause.BINNED, lens.note)


@lru_cache(maxsize=64)  # all images of a camera have the same
def lens_of(k: Intrinsics) -> Lens:
    """The lens of an image's intrinsics. Raises BadDocumentError."""
    if not (k.fx_px > 0 and k.fy_px > 0):
        raise BadDocumentError("focal lengths must be positive - at `$.intrinsics`")
    width, height = k.width_px, k.height_px
    if width is None or height is None:
        width, height = 0.0, 0.0
    elif not (width > 0 and height > 0):
        raise BadDocumentError("width and height must be positive - at `$.intrinsics`")
    lens = Lens(fx_px=k.fx_px, fy_px=k.fy_px, cx_px=k.cx_px, cy_px=k.cy_px, width_px=width, height_px=height)
    return lens.of_whole_image()


def check_pixels(coordinates: Sequence[float], at: str) -> None:
    """Raise BadDocumentError for pixels of an aircraft smaller than the image's first pixel."""
    if len(coordinates) > 2 and all(0.0 <= x <= 1.0 for x in coordinates):
        raise BadDocumentError(f"coordinates look normalised, from 0 to 1: send pixels - at `$.{at}`")


def check_target(target: str, field: str) -> None:
    """Raise BadDocumentError unless this can be a target's id: part of a key to publish under."""
    if not TARGET.fullmatch(target):
        raise BadDocumentError(f"letters, digits and -_. with / between, 64 at most - at `$.{field}`")
