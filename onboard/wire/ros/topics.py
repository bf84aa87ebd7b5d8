"""Decoders of the cameras' ROS 2 topics: detections and CameraInfo, by key.

Keys are those of rmw_zenoh (`domain/topic/type/hash`) and of zenoh-bridge-ros2dds (the topic alone), whose topics
are configured, and those of `onboard ros2`, which name the camera: `onboard/1/camera/front/ros/package/Type`.
"""

import re
from collections.abc import Collection
from typing import Final

from onboard.geometry.lens import Lens
from onboard.messages import Datagram, Exposure
from onboard.messages.text import plain
from onboard.wire.documents.cameras import CameraInput, Cameras, find
from onboard.wire.documents.detections import Ignore, exposure_of
from onboard.wire.documents.document import BadDocumentError, Refuse
from onboard.wire.ros.received import CAMERA_INFO, DECODERS, decode_camera_info

MIN_CHUNK_COUNT: Final = 4  # of rmw_zenoh's keys: domain, topic, type, hash
NODE_KEY: Final = re.compile(r"onboard/[^/]+/camera/([^/]+)/ros/([^/]+/[^/]+)")  # camera, type


class RosDecoder:
    """Decoder of our cameras' topics; a CameraInfo sets the lens of the images that follow."""

    def __init__(self, cameras: Cameras) -> None:
        self._cameras = cameras
        self._seen = {camera.ros.seen: camera for camera in cameras.values() if camera.ros.seen}
        self._infos = [camera for camera in cameras.values() if camera.ros.info]
        self._lenses: dict[str, Lens] = {}  # that a CameraInfo had, by camera

    def decode(self, datagram: Datagram, refuse: Refuse, ignore: Ignore) -> list[Exposure]:
        """The exposures of one message, none of a CameraInfo. Raises BadDocumentError."""
        sent = NODE_KEY.fullmatch(datagram.channel)
        if sent is not None:
            camera, kind = find(self._cameras, sent[1]), sent[2]
            of_info = [camera] if kind == CAMERA_INFO else []
        else:
            topic, kind = self._named(datagram.channel)
            of_info = [camera for camera in self._infos if camera.ros.info == topic]
            camera = of_info[0] if of_info else self._seen[topic]
            kind = kind or (CAMERA_INFO if of_info else camera.ros.kind)
        _check(kind, (CAMERA_INFO,) if of_info else DECODERS)
        for one in of_info:
            lens = decode_camera_info(datagram.data, one.ros.is_rectified)
            if lens != self._lenses.get(one.name):  # one that is the same knows its edges already
                self._lenses[one.name] = lens
        if of_info:
            return []
        document = DECODERS[kind](datagram.data)
        found = exposure_of(document, datagram.t_recv_ns, camera, self._lens(camera), refuse, ignore)
        return [found] if found else []

    def _named(self, key: str) -> tuple[str, str]:
        """The topic of a key, and the type if the key states it.

        Keys are `domain/topic/type/hash` (rmw_zenoh) or the topic (zenoh-bridge-ros2dds). Raises BadDocumentError,
        which names all topics.
        """
        known = {*self._seen, *(camera.ros.info for camera in self._infos)}
        if key in known:
            return key, ""
        chunks = key.split("/")
        topic = "/".join(chunks[1:-2])
        if len(chunks) < MIN_CHUNK_COUNT or topic not in known:
            raise BadDocumentError(f"no camera has this `ros_topic`; known: {', '.join(sorted(known)) or 'none'}")
        return topic, chunks[-2].replace("::msg::dds_::", "/").removesuffix("_")

    def _lens(self, camera: CameraInput) -> Lens:
        """The lens of a camera, of its CameraInfo or as configured.

        Raises BadDocumentError before the CameraInfo of `ros_camera_info` has come.
        """
        lens = self._lenses.get(camera.name) or (None if camera.ros.info else camera.lens)
        if lens is None:
            raise BadDocumentError(f"no CameraInfo has come on `{camera.ros.info}` yet: its lens is not known")
        return lens


def _check(kind: str, known: Collection[str]) -> None:
    """Raise BadDocumentError for a type that is not read."""
    if kind not in known:
        raise BadDocumentError(f"the topic is of {plain(kind)}; expected {', '.join(sorted(known))}")
