"""What decoding needs to know of our cameras, by their names."""

from collections.abc import Mapping
from typing import NamedTuple

from onboard.geometry.lens import Lens
from onboard.messages.target import WING_POINTS
from onboard.wire.document import BadDocumentError


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


Cameras = Mapping[str, CameraInput]  # the first is meant where none is named


def find(cameras: Cameras, name: str) -> CameraInput:
    """The camera of that name, the first without one. Raises BadDocumentError, which names all."""
    camera = cameras.get(name) if name else next(iter(cameras.values()), None)
    if camera is None:
        raise BadDocumentError(f"no camera is called `{name}`; known: {', '.join(cameras)} - at `$.camera`")
    return camera
