"""What decoding needs to know of our cameras, by their names."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from onboard.geometry.camera import Camera
from onboard.geometry.lens import Lens
from onboard.messages.causes import Cause
from onboard.messages.target import WING_POINTS
from onboard.wire.documents.document import BadDocumentError


class RosTopics(NamedTuple):
    """Where a camera is in ROS: the topic of what it sees, of which type where the key does not say it, the topic
    of its CameraInfo, and whether pixels are of the rectified image."""

    seen: str = ""
    kind: str = ""
    info: str = ""
    is_rectified: bool = False


class CameraInput(NamedTuple):
    """A camera whose detections may come: its lens, the noise of an image coordinate without a sigma of its own,
    the confidence below which a detection is refused, the classes that are followed (none: any), and the names of
    the points that any class of targets has."""

    name: str
    lens: Lens
    sigma_px: float
    min_confidence: float
    classes: tuple[str, ...] = ()
    points: tuple[str, ...] = WING_POINTS
    tracker: int | None = None  # the MAVLink component whose CAMERA_TRACKING_IMAGE_STATUS is of this camera
    is_landing_target: bool = False  # each LANDING_TARGET is a whole aircraft, seen by this camera
    mount: Camera | None = None
    sizes: tuple[float, float] = (0.0, math.inf)  # m: wingspans of what it may see
    ros: RosTopics = RosTopics()


Cameras = Mapping[str, CameraInput]  # the first is meant where none is named


def find(cameras: Cameras, name: str) -> CameraInput:
    """The camera of that name, the first without one. Raises BadDocumentError, which names all."""
    camera = cameras.get(name) if name else next(iter(cameras.values()), None)
    if camera is None:
        known = ", ".join(cameras)
        raise BadDocumentError(
            f"no camera is called `{name}`; known: {known} - at `$.camera`", Cause.UNKNOWN_CAMERA
        )
    return camera
