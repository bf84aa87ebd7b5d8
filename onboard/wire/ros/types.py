"""Messages of ROS 2 as the library rosbags encodes them. Needs the extra `ros2`."""

from typing import Any, Final

from onboard.messages.ros import RosTopic

# vision_msgs 4 (Humble and later), which rosbags lacks: names and fields, in the order of its definitions
VISION: Final = {
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id\n"
    ),
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}


class RosTypes:
    """Messages by name. `store` is the typestore of rosbags."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - an extra

        self.store: Any = get_typestore(Stores.ROS2_JAZZY)
        for name, text in VISION.items():
            self.store.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))

    def make(self, kind: str, *fields: Any) -> Any:
        """A message of a type (`package/Name`), of its fields in order."""
        package, _, name = kind.partition("/")
        return self.store.types[f"{package}/msg/{name}"](*fields)

    def topic(self, name: str, kind: str) -> RosTopic:
        """A topic with messages of a type (`package/Name`)."""
        full = kind.replace("/", "/msg/")
        return RosTopic(name, full, self.store.hash_rihs01(full))

    def encode(self, message: Any) -> bytes:
        """CDR, little-endian, with its four bytes of header."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__, little_endian=True))
