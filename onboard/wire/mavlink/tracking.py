"""Decoders of MAVLink messages that each show a whole aircraft, as detections.

- CAMERA_FOV_STATUS states a camera's zoom, which sets the focal length of the images that follow.
- CAMERA_TRACKING_IMAGE_STATUS: a rectangle is a box, and so is a point with a radius; a point alone is the center.
  It has no time: its arrival counts, less the camera's `delay_s`.
- LANDING_TARGET, where a camera has `landing_target = "aircraft"`: with `size_x` or `size_y` it is a box, else the
  center, at `angle_x` and `angle_y`. With `position_valid` it is a pose in the body's axes without a covariance.
  Without a position, `distance` is the range.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.geometry.lens import Lens
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_matrix
from onboard.messages import (
    Box,
    CameraDetections,
    Clock,
    DetectedPoint,
    DetectedPose,
    Detection,
    Exposure,
    FieldOfView,
)
from onboard.messages.causes import Cause, Reason
from onboard.messages.mavlink_enums import BODY_FRD
from onboard.wire.documents.cameras import CameraInput, Cameras
from onboard.wire.documents.detections import MAX_RANGE_M, exposure_of
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.poses import TO_C

ACTIVE: Final = dialect.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
COASTING: Final = dialect.CAMERA_TRACKING_STATUS_FLAGS_COASTING
ZOOM_TOLERANCE: Final = 0.05  # a calibrated focal length is better than a stated one this close
MAX_ZOOM_RATIO: Final = 200.0  # hybrid zooms of gimbal cameras reach 180
UNKNOWN_Q: Final = ((0.0,) * 4, (1.0, 0.0, 0.0, 0.0))  # what senders fill in that know no rotation
Refuse = Callable[[Reason, int], None]


def ignore(*_: object) -> None:
    """Drop a message that cannot be used."""


class TrackerDecoder:
    """Decoder of trackers; `refuse` receives reason and arrival of unusable messages."""

    def __init__(self, cameras: Cameras, refuse: Refuse = ignore) -> None:
        self._refuse = refuse
        self._trackers = {c.tracker: c for c in cameras.values() if c.tracker is not None}
        # By system and component: a camera's zoom is that of its own images, whichever of them count.
        self._lenses: dict[tuple[int, int], Lens] = {}
        self._landing = next((c for c in cameras.values() if c.is_landing_target), None)

    @property
    def takes_landing_targets(self) -> bool:
        """Whether each LANDING_TARGET is an aircraft, not one of its points."""
        return self._landing is not None

    def tracking(self, fields: tuple[Any, ...], header: dict[str, Any]) -> Exposure | None:
        """The image of a CAMERA_TRACKING_IMAGE_STATUS, None if nothing is tracked."""
        camera = self._trackers.get(header["component"])
        status = fields[7]
        if camera is None or not status & ACTIVE or status & COASTING:
            return None
        head = header | {"t_ns": header["t_recv_ns"], "clock": Clock.HOST}
        lens = self._lenses.get((header["system"], header["component"]), camera.lens)
        return self._image(camera, lens, head, lambda: _tracked(fields, lens))

    def field_of_view(self, fields: tuple[Any, ...], header: dict[str, Any]) -> FieldOfView | None:
        """Set a tracking camera's zoom by the horizontal field of view of a CAMERA_FOV_STATUS."""
        camera, hfov = self._trackers.get(header["component"]), math.radians(fields[11])
        if camera is None or hfov == 0.0 or math.isnan(hfov):  # not known
            return None
        lens = camera.lens
        edge_px = lens.pixel(math.tan(0.5 * hfov), 0.0)[0] - lens.cx_px if 0.0 < hfov < math.pi else 0.0
        zoom = 0.5 * lens.width_px / edge_px if edge_px > 0.0 else 0.0
        if not 1.0 / MAX_ZOOM_RATIO <= zoom <= MAX_ZOOM_RATIO:
            words = f"CAMERA_FOV_STATUS: an hfov of {fields[11]:.7g} degrees is no zoom of the configured lens"
            self._refuse(Reason(Cause.DOCUMENT, words), header["t_recv_ns"])
            return None
        if abs(zoom - 1.0) < ZOOM_TOLERANCE:
            zoom = 1.0
        zoomed = dataclasses.replace(lens, fx_px=zoom * lens.fx_px, fy_px=zoom * lens.fy_px)
        self._lenses[header["system"], header["component"]] = zoomed
        return FieldOfView(**header, hfov=hfov)

    def landing_target(self, fields: tuple[Any, ...], header: dict[str, Any]) -> Exposure | None:
        """The image of a LANDING_TARGET that is a whole aircraft; target 0 is the leader."""
        camera = self._landing
        if camera is None:
            return None
        number = fields[6]
        target = "leader" if number == 0 else f"target/{number}"
        ideal = camera.lens.undistorted
        return self._image(camera, ideal, header, lambda: replace(_landed(fields, camera, ideal), target=target))

    def _image(
        self, camera: CameraInput, lens: Lens, header: dict[str, Any], detect: Callable[[], Detection]
    ) -> Exposure | None:
        t_recv_ns = header["t_recv_ns"]
        try:
            document = CameraDetections(t_ns=header["t_ns"], clock=header["clock"], detections=(detect(),))
        except BadDocumentError as error:
            self._refuse(error.why, t_recv_ns)
            return None
        found = exposure_of(document, t_recv_ns, camera, lens, lambda why: self._refuse(why, t_recv_ns), ignore)
        if found is None:
            return None
        sender = {"system": header["system"], "component": header["component"]}
        return Exposure.of(*(replace(image, **sender) for image in found.detections))


def _tracked(f: tuple[Any, ...], lens: Lens) -> Detection:
    """Shares of the image's width and height as pixels. Raises BadDocumentError."""
    x, y, radius, left, top, right, bottom, _, mode, *_ = f
    width, height = lens.width_px, lens.height_px
    if mode == dialect.CAMERA_TRACKING_MODE_RECTANGLE:
        if not (0.0 <= left < right <= 1.0 and 0.0 <= top < bottom <= 1.0):
            raise BadDocumentError("CAMERA_TRACKING_IMAGE_STATUS: a rectangle from 0 to 1, its top left first")
        return _box(
            0.5 * (left + right) * width,
            0.5 * (top + bottom) * height,
            (right - left) * width,
            (bottom - top) * height,
        )
    if mode != dialect.CAMERA_TRACKING_MODE_POINT or not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0):
        raise BadDocumentError("CAMERA_TRACKING_IMAGE_STATUS: expected a point or rectangle from 0 to 1")
    if radius > 0.0 and math.isfinite(radius):
        return _box(x * width, y * height, 2 * radius * width, 2 * radius * width)
    return Detection(points={"center": DetectedPoint(u_px=x * width, v_px=y * height)})


def _landed(f: tuple[Any, ...], camera: CameraInput, lens: Lens) -> Detection:
    """Angles as pixels of a `lens` without distortion, or a pose. Raises BadDocumentError."""
    _, angle_x, angle_y, distance, size_x, size_y, _, frame, x, y, z, *q, _, is_position = f
    if is_position:
        return Detection(pose=_pose(camera, frame, (x, y, z), q))
    if not (size_x >= 0.0 and size_y >= 0.0):
        raise BadDocumentError("LANDING_TARGET: size_x and size_y must be 0 (not known) or positive angles")
    wide, high = size_x or size_y, size_y or size_x
    edges = angle_x - wide / 2, angle_x + wide / 2, angle_y - high / 2, angle_y + high / 2
    if not max(map(abs, edges)) < math.pi / 2:
        raise BadDocumentError("LANDING_TARGET: angle_x and angle_y must be within 90 degrees of the axis")
    (left, upper), (right, lower) = (lens.pixel(*map(math.tan, edges[k::2])) for k in (0, 1))
    range_m = distance if 0.0 < distance < MAX_RANGE_M else None
    if wide > 0.0:
        box = _box(0.5 * (left + right), 0.5 * (upper + lower), right - left, lower - upper)
        return replace(box, range_m=range_m)
    return Detection(points={"center": DetectedPoint(u_px=left, v_px=upper)}, range_m=range_m)


def _pose(camera: CameraInput, frame: int, r: tuple[float, float, float], q: list[float]) -> DetectedPose:
    """The pose of a target at r in our body's axes, turned by q. Raises BadDocumentError."""
    mount = camera.mount
    if frame != BODY_FRD or not all(map(math.isfinite, r)):
        raise BadDocumentError(f"LANDING_TARGET: a position in frame {frame}; expected MAV_FRAME_BODY_FRD (12)")
    if mount is None or mount.gimbal is not None:
        raise BadDocumentError("LANDING_TARGET: a position needs a camera with a fixed mount")
    forward, right, down = (mount.R_bc.T @ (np.array(r) - mount.r_FC_b)).tolist()
    if not forward > 0.0:
        raise BadDocumentError("LANDING_TARGET: the position x, y, z is behind the camera")
    if not all(map(math.isfinite, q)) or tuple(q) in UNKNOWN_Q:
        return DetectedPose(position_m=(right, down, forward))
    turned = TO_C.T @ mount.R_bc.T @ matrix_from_quaternion(q)
    w, i, j, k = quaternion_from_matrix(turned).tolist()
    return DetectedPose(position_m=(right, down, forward), q=(w, i, j, k))


def _box(u: float, v: float, width: float, height: float) -> Detection:
    return Detection(box=Box(u_px=u, v_px=v, width_px=width, height_px=height))
