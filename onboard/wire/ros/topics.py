"""What cameras send in ROS 2, by topic: what they see, and the CameraInfo that says through which lens."""

from collections.abc import Collection
from typing import Final

from onboard.geometry.lens import Lens
from onboard.messages import Datagram, Exposure
from onboard.messages.text import plain
from onboard.wire.documents.cameras import CameraInput, Cameras
from onboard.wire.documents.detections import Ignore, exposure_of
from onboard.wire.documents.document import BadDocumentError, Refuse
from onboard.wire.ros.cdr import CAMERA_INFO, DECODERS, decode_camera_info

CHUNKS: Final = 4  # of rmw_zenoh's keys at least: domain, topic, type, hash


class RosDecoder:
    """Messages on the topics of our cameras. A lens that a CameraInfo has is that of the images that come after
    it."""

    def __init__(self, cameras: Cameras) -> None:
        self._seen = {camera.ros.seen: camera for camera in cameras.values() if camera.ros.seen}
        self._infos = [camera for camera in cameras.values() if camera.ros.info]
        self._lenses: dict[str, Lens] = {}  # that a CameraInfo had, by camera

    def decode(self, datagram: Datagram, refuse: Refuse, ignore: Ignore) -> list[Exposure]:
        """What one message shows; nothing of a CameraInfo. Raises BadDocumentError."""
        topic, kind = self._named(datagram.channel)
        of_info = [camera for camera in self._infos if camera.ros.info == topic]
        if of_info:
            _check(kind or CAMERA_INFO, (CAMERA_INFO,))
            for camera in of_info:
                lens = decode_camera_info(datagram.data, camera.ros.is_rectified)
                if lens != self._lenses.get(camera.name):  # one that is the same knows its edges already
                    self._lenses[camera.name] = lens
            return []
        camera = self._seen[topic]
        kind = kind or camera.ros.kind
        _check(kind, DECODERS)
        document = DECODERS[kind](datagram.data)
        found = exposure_of(document, datagram.t_recv_ns, camera, self._lens(camera), refuse, ignore)
        return [found] if found else []

    def _named(self, key: str) -> tuple[str, str]:
        """The topic of a key, and the type that it states: `domain/topic/type/hash` (rmw_zenoh), or the topic
        alone (zenoh-bridge-ros2dds). Raises BadDocumentError, which names all topics."""
        known = {*self._seen, *(camera.ros.info for camera in self._infos)}
        if key in known:
            return key, ""
        chunks = key.split("/")
        topic = "/".join(chunks[1:-2])
        if len(chunks) < CHUNKS or topic not in known:
            raise BadDocumentError(f"no camera has this `ros_topic`; known: {', '.join(sorted(known)) or 'none'}")
        return topic, chunks[-2].replace("::msg::dds_::", "/").removesuffix("_")

    def _lens(self, camera: CameraInput) -> Lens:
        """The lens of a camera's images. Raises BadDocumentError before its CameraInfo has come."""
        lens = self._lenses.get(camera.name) if camera.ros.info else camera.lens
        if lens is None:
            raise BadDocumentError(f"no CameraInfo has come on `{camera.ros.info}` yet: its lens is not known")
        return lens


def _check(kind: str, known: Collection[str]) -> None:
    """Raise BadDocumentError for a type that is not read."""
    if kind not in known:
        raise BadDocumentError(f"the topic is of {plain(kind)}; expected {', '.join(sorted(known))}")
