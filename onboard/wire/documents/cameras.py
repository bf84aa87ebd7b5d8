"""Properties of the cameras that decoding needs, by name."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from onboard.geometry.camera import Camera
from onboard.geometry.lens import Lens
from onboard.messages.causes import Cause
from onboard.messages.target import WING_POINTS
from onboard.wire.documents.document import BadDocumentError


class RosTopics(NamedTuple):
    """The ROS topics of a camera."""

    seen: str = ""  # topic of the detections
    kind: str = ""  # their type, for keys that do not state it
    info: str = ""  # topic of CameraInfo
    is_rectified: bool = False  # whether pixels are of the rectified image


class CameraInput(NamedTuple):
    """A camera whose detections are decoded."""

    name: str
    lens: Lens
    sigma_px: float  # default of an image coordinate
    min_confidence: float
    classes: tuple[str, ...] = ()  # that are followed; empty: any
    points: tuple[str, ...] = WING_POINTS  # names of the targets' points
    tracker: int | None = None  # the MAVLink component whose CAMERA_TRACKING_IMAGE_STATUS is of this camera
    is_landing_target: bool = False  # each LANDING_TARGET is a whole aircraft, seen by this camera
    mount: Camera | None = None
    sizes: tuple[float, float] = (0.0, math.inf)  # m, range of the targets' wingspans
    ros: RosTopics = RosTopics()


Cameras = Mapping[str, CameraInput]  # the first is meant where none is named


def find(cameras: Cameras, name: str) -> CameraInput:
    """The camera of that name, the first if empty. Raises BadDocumentError, which names all."""
    camera = cameras.get(name) if name else next(iter(cameras.values()), None)
    if camera is None:
        known = ", ".join(cameras)
        raise BadDocumentError(
            f"no camera is called `{name}`; known: {known} - at `$.camera`", Cause.UNKNOWN_CAMERA
        )
    return camera
