"""ROS 2 messages of cameras, in CDR, -> our own documents. Needs the extra `ros2`.

A pose is that of the aircraft, with the axes of REP 103 (forward, left, up), in the camera's optical frame (right,
down, forward). ROS has no value for "unknown": a position of exactly 0, an orientation that is exactly that of the
frame, and variances of 0, below 0 or above that of any angle are taken as not stated.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, Final, Literal

import msgspec
import numpy as np

from onboard.geometry.lens import Lens
from onboard.messages import Box, CameraDetections, Clock, DetectedPoint, DetectedPose, Detection
from onboard.messages.text import plain
from onboard.units import NS_PER_S
from onboard.wire.documents.document import MAX_DOCUMENT_BYTES, MAX_TIME_NS, BadDocumentError
from onboard.wire.ros.camera_info import lens_of_info
from onboard.wire.ros.types import MISSING, RosTypes

RosKind = Literal[
    "vision_msgs/Detection2DArray",
    "vision_msgs/Detection3DArray",
    "geometry_msgs/PoseWithCovarianceStamped",
    "apriltag_msgs/AprilTagDetectionArray",
]
CAMERA_INFO: Final = "sensor_msgs/CameraInfo"
ANY_ANGLE: Final = math.pi**2 / 3.0  # rad^2: variance of an angle that may be any
NO_TURN: Final = (0.0, 0.0, 0.0, 1.0)
NO_COVARIANCE: Final = np.zeros((6, 6))
# of REP 105, and below a prefix: none of them is a camera's optical frame
FRAMES: Final = ("earth", "map", "odom", "world", "base_link", "base_footprint")
_TYPES: Final = RosTypes()  # built with the first message


def decode_boxes(data: bytes) -> CameraDetections:
    """Decode vision_msgs/Detection2DArray to boxes, with the best class and its score.

    Raises BadDocumentError, as all below do, for bytes that are no such message.
    """
    message = _decoded(data, "vision_msgs/Detection2DArray")
    found = [_detection(one, f"detections[{i}]") for i, one in enumerate(message.detections)]
    return _image((message, *message.detections), found)


def decode_volumes(data: bytes) -> CameraDetections:
    """Decode vision_msgs/Detection3DArray to poses of the best hypothesis, else of the box.

    The size of the box is not used.
    """
    message = _decoded(data, "vision_msgs/Detection3DArray")
    _check_frame(message.header.frame_id)
    return _image((message, *message.detections), map(_volume, message.detections))


def decode_pose(data: bytes) -> CameraDetections:
    """geometry_msgs/PoseWithCovarianceStamped: the pose of one aircraft."""
    message = _decoded(data, "geometry_msgs/PoseWithCovarianceStamped")
    _check_frame(message.header.frame_id)
    pose = _pose(message.pose)
    if pose is None:
        raise BadDocumentError("neither position nor orientation is set - at `$.pose`")
    return _image((message,), [Detection(pose=pose)])


def decode_tags(data: bytes) -> CameraDetections:
    """Decode apriltag_msgs/AprilTagDetectionArray of upright tags across the forward axis.

    The middle is the center, the middles of the sides are `left` and `right`: the tag's side is the wingspan. The
    class is the tag's family and id, as apriltag_ros names its frame: `tag36h11:0`.
    """
    message = _decoded(data, "apriltag_msgs/AprilTagDetectionArray")
    return _image((message,), map(_tag, message.detections))


def decode_camera_info(data: bytes, is_rectified: bool) -> Lens:
    """Decode the lens of a sensor_msgs/CameraInfo, for raw or rectified images.

    Raises BadDocumentError, also for a camera that is not calibrated.
    """
    m = _decoded(data, CAMERA_INFO)
    p, d, model = m.p.tolist(), m.d.tolist(), m.distortion_model or ("" if m.d.any() else "plumb_bob")
    k = m.k.tolist()
    if is_rectified:
        k, d, model = [p[0], p[1], p[2], p[4], p[5], p[6], *p[8:11]], [], "plumb_bob"
    if not k[0]:
        raise BadDocumentError("the camera is not calibrated: its focal length is 0")
    table = {name: getattr(m, name) for name in ("height", "width", "binning_x", "binning_y")}
    roi = {name: getattr(m.roi, name) for name in ("x_offset", "y_offset", "height", "width")}
    try:
        return lens_of_info({**table, "k": k, "d": d, "distortion_model": model, "roi": roi})
    except ValueError as error:
        raise BadDocumentError(f"CameraInfo: {error}") from error


DECODERS: Final[dict[str, Callable[[bytes], CameraDetections]]] = {
    "vision_msgs/Detection2DArray": decode_boxes,
    "vision_msgs/Detection3DArray": decode_volumes,
    "geometry_msgs/PoseWithCovarianceStamped": decode_pose,
    "apriltag_msgs/AprilTagDetectionArray": decode_tags,
}


def _decoded(data: bytes, kind: str) -> Any:
    """The message of a type. Raises BadDocumentError."""
    if len(data) > MAX_DOCUMENT_BYTES:
        raise BadDocumentError(f"the message has more than {MAX_DOCUMENT_BYTES} bytes")
    try:
        return _TYPES.decode(data, kind)
    except ImportError as error:
        raise BadDocumentError(MISSING) from error
    except ValueError as error:
        raise BadDocumentError(str(error)) from error


def _image(stamped: Iterable[Any], detections: Iterable[Detection]) -> CameraDetections:
    """Detections at the first time that a header states."""
    times = (one.header.stamp.sec * NS_PER_S + one.header.stamp.nanosec for one in stamped)
    t_ns = next(filter(None, times), 0)
    if not 0 < t_ns < MAX_TIME_NS:
        raise BadDocumentError("`header.stamp` is not set; expected the time of exposure")
    return CameraDetections(t_ns=t_ns, clock=Clock.HOST, detections=tuple(detections))


def _check_frame(frame: str) -> None:
    """Raise BadDocumentError for a frame that is no camera's."""
    if frame.rpartition("/")[2] in FRAMES:
        raise BadDocumentError(
            f"`header.frame_id` is `{plain(frame)}`; expected the camera's optical frame: right, down, forward"
        )


def _detection(one: Any, at: str) -> Detection:
    """Convert a vision_msgs/Detection2D; a rotated box becomes the upright box around it."""
    center, width, height = one.bbox.center, one.bbox.size_x, one.bbox.size_y
    u, v, theta = center.position.x, center.position.y, center.theta
    if not all(map(math.isfinite, (u, v, theta, width, height))):
        raise BadDocumentError(f"expected finite numbers - at `$.{at}.bbox`")
    c, s = abs(math.cos(theta)), abs(math.sin(theta))
    box = Box(u_px=u, v_px=v, width_px=c * width + s * height, height_px=s * width + c * height)
    return Detection(box=box, **_named(one))


def _volume(one: Any) -> Detection:
    """vision_msgs/Detection3D; without a pose where none is stated."""
    best = _best(one)
    pose = None if best is None else _pose(best.pose)
    if pose is None or pose.position_m is None:
        pose = _stated(one.bbox.center.position, None, NO_COVARIANCE) or pose
    return Detection(pose=pose, **_named(one))


def _best(one: Any) -> Any:
    """The hypothesis of a detection with the highest score; None if it has none."""
    return max(one.results, key=lambda result: result.hypothesis.score, default=None)


def _named(one: Any) -> dict[str, Any]:
    """The id of a detection, and class and score of its best hypothesis."""
    best = _best(one)
    named = {"id": one.id or None}
    if best is None:
        return named
    return named | {"class_name": best.hypothesis.class_id, "confidence": best.hypothesis.score}


def _tag(tag: Any) -> Detection:
    """Convert an AprilTagDetection, whose corners run counter-clockwise from the lower left."""
    lower_left, lower_right, upper_right, upper_left = [(corner.x, corner.y) for corner in tag.corners]
    points = {
        "center": (tag.centre.x, tag.centre.y),
        "left": np.mean([lower_left, upper_left], axis=0),
        "right": np.mean([lower_right, upper_right], axis=0),
    }
    named = {name: DetectedPoint(u_px=float(u), v_px=float(v)) for name, (u, v) in points.items()}
    return Detection(points=named, class_name=f"{tag.family}:{tag.id}", id=tag.id)


def _pose(spread: Any) -> DetectedPose | None:
    """geometry_msgs/PoseWithCovariance as far as it is stated; None: it states nothing."""
    return _stated(spread.pose.position, spread.pose.orientation, np.reshape(spread.covariance, (6, 6)))


def _stated(position: Any, turn: Any, P: Any) -> DetectedPose | None:
    """A pose of its position, orientation and covariance (6, 6), as far as they are stated."""
    x, y, z = position.x, position.y, position.z
    i, j, k, w = NO_TURN if turn is None else (turn.x, turn.y, turn.z, turn.w)
    r_known = any((x, y, z))
    variances = np.diag(P)
    stated = [bool((part > 0.0).all()) for part in (variances[:3], variances[3:])]
    q_known = any((i, j, k)) and not (variances[3:] >= ANY_ANGLE).any() and (stated[1] or not stated[0])
    if not (r_known or q_known):
        return None
    is_whole = (stated[0] or not r_known) and (stated[1] or not q_known)
    return msgspec.convert(
        {
            "position_m": (x, y, z) if r_known else None,
            "q": (-i, w, k, -j) if q_known else None,  # half a turn about x: from forward, right, down
            "covariance": P.tolist() if is_whole else None,
        },
        DetectedPose,
    )
