"""Encoding and decoding of ROS 2 messages by rosbags. Needs the extra `ros2`."""

from functools import cached_property
from typing import Any, Final

from onboard import with_extra
from onboard.messages.ros import RosTopic

# Names and fields that rosbags lacks, in the order of the definitions: vision_msgs 4 (Humble and later) ...
VISION: Final = {
    "Point2D": "float64 x\nfloat64 y\n",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id\n"
    ),
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
    "Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id\n"
    ),
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}
# ... and apriltag_msgs
APRILTAG: Final = {
    "Point": "float64 x\nfloat64 y\n",
    "AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "apriltag_msgs/Point centre\napriltag_msgs/Point[4] corners\nfloat64[9] homography\n"
    ),
    "AprilTagDetectionArray": "std_msgs/Header header\napriltag_msgs/AprilTagDetection[] detections\n",
}
MISSING: Final = f"messages of ROS 2 need rosbags: {with_extra('ros2')}"
DEFINITIONS: Final = {"vision_msgs": VISION, "apriltag_msgs": APRILTAG}


class RosTypes:
    """ROS types by name, `package/Name`; all methods raise ImportError without rosbags."""

    @cached_property
    def store(self) -> Any:
        """The typestore of rosbags."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - an extra

        store: Any = get_typestore(Stores.ROS2_JAZZY)
        for package, definitions in DEFINITIONS.items():
            for name, text in definitions.items():
                store.register(get_types_from_msg(text, f"{package}/msg/{name}"))
        return store

    def make(self, kind: str, *fields: Any) -> Any:
        """A message of a type, of its fields in order."""
        return self.store.types[full_name(kind)](*fields)

    def topic(self, name: str, kind: str) -> RosTopic:
        """A topic with messages of a type."""
        full = full_name(kind)
        return RosTopic(name, full, self.store.hash_rihs01(full))

    def encode(self, message: Any) -> bytes:
        """CDR, little-endian, with its four bytes of header."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__, little_endian=True))

    def decode(self, data: bytes, kind: str) -> Any:
        """The message in CDR of either byte order. Raises ValueError."""
        try:
            return self.store.deserialize_cdr(data, full_name(kind))
        except ImportError:
            raise
        except Exception as error:  # of any kind: bytes may come from anybody
            raise ValueError(f"the bytes are no {kind}: {error}") from error


def full_name(kind: str) -> str:
    """`package/Name` as ROS and rosbags have it: `package/msg/Name`."""
    return kind.replace("/", "/msg/")
