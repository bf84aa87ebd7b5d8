"""What cameras send in ROS 2, as rmw_zenoh carries it: CDR, in the publisher's byte order.

A message begins with four bytes that say the byte order (0x00 0x01: little-endian). Numbers are aligned to their
own size from there on; strings and sequences begin with a count of 32 bits, and strings end in NUL (OMG's Common
Data Representation, version 1). The fields are those of vision_msgs 4, which came with ROS 2 Humble, of
apriltag_msgs, geometry_msgs and sensor_msgs.

A pose is that of the aircraft, with the axes of REP 103 (forward, left, up), in the camera's optical frame (right,
down, forward). No message says what of it is known: a position of exactly 0, an orientation that is exactly the
frame's, and variances of 0, below 0 or above that of any angle are taken as not stated.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, Final, Literal

import msgspec
import numpy as np

from onboard.geometry.lens import Lens
from onboard.messages import Box, CameraDetections, Clock, DetectedPoint, DetectedPose, Detection
from onboard.messages.text import plain
from onboard.units import NS_PER_S
from onboard.wire.documents.document import LARGEST, LATEST_NS, BadDocumentError
from onboard.wire.ros.camera_info import lens_of_info

RosKind = Literal[
    "vision_msgs/Detection2DArray",
    "vision_msgs/Detection3DArray",
    "geometry_msgs/PoseWithCovarianceStamped",
    "apriltag_msgs/AprilTagDetectionArray",
]
CAMERA_INFO: Final = "sensor_msgs/CameraInfo"
ORDERS: Final = {b"\0\0": ">", b"\0\1": "<"}
COVARIANCE_SIZE: Final = 36
ANY_ANGLE: Final = math.pi**2 / 3.0  # rad^2: variance of an angle that may be any
# of REP 105, and below a prefix: none of them is a camera's optical frame
FRAMES: Final = ("earth", "map", "odom", "world", "base_link", "base_footprint")


def decode_boxes(data: bytes) -> CameraDetections:
    """vision_msgs/Detection2DArray: a box each, with the class and score of its best hypothesis.

    Raises BadDocumentError, as all below do, for bytes that are no such message.
    """
    reader = _opened(data)
    reader.header()
    found = [reader.detection(f"detections[{i}]") for i in range(reader.count(least=4))]
    return _image(reader.t_ns, found)


def decode_volumes(data: bytes) -> CameraDetections:
    """vision_msgs/Detection3DArray: a pose each, that of its best hypothesis, or the position of its box where
    that states none. The size of the box is not used."""
    reader = _opened(data)
    _, frame = reader.header()
    found = [reader.volume() for _ in range(reader.count(least=4))]
    _check_frame(frame)
    return _image(reader.t_ns, found)


def decode_pose(data: bytes) -> CameraDetections:
    """geometry_msgs/PoseWithCovarianceStamped: the pose of one aircraft."""
    reader = _opened(data)
    t_ns, frame = reader.header()
    pose = _pose(reader.numbers(f"{7 + COVARIANCE_SIZE}d", 8))
    _check_frame(frame)
    if pose is None:
        raise BadDocumentError("neither position nor orientation is set - at `$.pose`")
    return _image(t_ns, [Detection(pose=pose)])


def decode_tags(data: bytes) -> CameraDetections:
    """apriltag_msgs/AprilTagDetectionArray: tags that stand across the forward axis, upright. The middle is the
    center, the middles of the sides are `left` and `right`: the tag's side is the wingspan. The class is the tag's
    family and id, as apriltag_ros names its frame: `tag36h11:0`."""
    reader = _opened(data)
    t_ns, _ = reader.header()
    return _image(t_ns, [reader.tag() for _ in range(reader.count(least=4))])


def decode_camera_info(data: bytes, is_rectified: bool) -> Lens:
    """sensor_msgs/CameraInfo: the lens of the images as they are, or of the rectified ones. Raises
    BadDocumentError, also for a camera that is not calibrated."""
    table = _opened(data).camera_info()
    if is_rectified:
        p = table["p"]
        k = [p[0], p[1], p[2], p[4], p[5], p[6], *p[8:11]]
        table |= {"k": k, "d": [], "distortion_model": "plumb_bob"}
    if not table["k"][0]:
        raise BadDocumentError("the camera is not calibrated: its focal length is 0")
    try:
        return lens_of_info(table)
    except ValueError as error:
        raise BadDocumentError(f"CameraInfo: {error}") from error


DECODERS: Final[dict[str, Callable[[bytes], CameraDetections]]] = {
    "vision_msgs/Detection2DArray": decode_boxes,
    "vision_msgs/Detection3DArray": decode_volumes,
    "geometry_msgs/PoseWithCovarianceStamped": decode_pose,
    "apriltag_msgs/AprilTagDetectionArray": decode_tags,
}


def _opened(data: bytes) -> "_Reader":
    """A reader of a message. Raises BadDocumentError."""
    if len(data) > LARGEST:
        raise BadDocumentError(f"the message has more than {LARGEST} bytes")
    order = ORDERS.get(data[:2])
    if order is None or len(data) < 4:
        raise BadDocumentError("it is not CDR: expected 00 00 or 00 01 in its first bytes")
    return _Reader(data[4:], order)


def _image(t_ns: int, detections: list[Detection]) -> CameraDetections:
    if not 0 < t_ns < LATEST_NS:
        raise BadDocumentError("`header.stamp` is not set; expected the time of exposure")
    return CameraDetections(t_ns=t_ns, clock=Clock.HOST, detections=tuple(detections))


def _check_frame(frame: str) -> None:
    """Raise BadDocumentError for a frame that is no camera's."""
    if frame.rpartition("/")[2] in FRAMES:
        raise BadDocumentError(
            f"`header.frame_id` is `{plain(frame)}`; expected the camera's optical frame: right, down, forward"
        )


def _pose(numbers: tuple[float, ...]) -> DetectedPose | None:
    """A pose and its covariance (43 numbers) as far as they are stated; None: they state nothing."""
    (x, y, z, i, j, k, w), P = numbers[:7], np.reshape(numbers[7:], (6, 6))
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


class _Reader:
    """Fields one after the other."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data, self._order, self._at = data, order, 0
        self.t_ns = 0  # of the first header that states a time

    def numbers(self, form: str, size: int) -> tuple[Any, ...]:
        """Numbers of one size, aligned. Raises BadDocumentError beyond the end."""
        at = -(-self._at // size) * size
        layout = struct.Struct(self._order + form)
        if at + layout.size > len(self._data):
            raise BadDocumentError(f"the message ends after {len(self._data)} bytes; its type is longer")
        self._at = at + layout.size
        return layout.unpack_from(self._data, at)

    def count(self, least: int) -> int:
        """The length of a sequence whose elements have `least` bytes or more."""
        (count,) = self.numbers("I", 4)
        if count * least > len(self._data) - self._at:
            raise BadDocumentError(f"a sequence of {count} does not fit into the message")
        return int(count)

    def text(self) -> str:
        """A string."""
        count = self.count(least=1)
        text = self._data[self._at : self._at + count]
        self._at += count
        return text.rstrip(b"\0").decode("utf-8", "replace")

    def header(self) -> tuple[int, str]:
        """std_msgs/Header: time in ns, frame_id."""
        sec, nanosec = self.numbers("iI", 4)
        t_ns = sec * NS_PER_S + nanosec
        self.t_ns = self.t_ns or t_ns
        return t_ns, self.text()

    def detection(self, at: str) -> Detection:
        """vision_msgs/Detection2D. A turned box counts with the sides of the upright one around it."""
        self.header()
        found = [self._hypothesis() for _ in range(self.count(least=8))]
        u, v, theta, width, height = self.numbers("5d", 8)
        track = self.text()
        if not all(map(math.isfinite, (u, v, theta, width, height))):
            raise BadDocumentError(f"expected finite numbers - at `$.{at}.bbox`")
        c, s = abs(math.cos(theta)), abs(math.sin(theta))
        box = Box(u_px=u, v_px=v, width_px=c * width + s * height, height_px=s * width + c * height)
        if not found:
            return Detection(box=box, id=track or None)
        name, score = max(found, key=lambda one: one[1])
        return Detection(box=box, class_name=name, confidence=score, id=track or None)

    def _hypothesis(self) -> tuple[str, float]:
        """vision_msgs/ObjectHypothesisWithPose of a box: class_id and score; the pose is not used."""
        name = self.text()
        score, *_ = self.numbers(f"{1 + 7 + COVARIANCE_SIZE}d", 8)
        return name, score

    def volume(self) -> Detection:
        """vision_msgs/Detection3D; without a pose where none is stated."""
        self.header()
        found = [(self.text(), self.numbers(f"{1 + 7 + COVARIANCE_SIZE}d", 8)) for _ in range(self.count(least=8))]
        box = self.numbers("10d", 8)
        track = self.text()
        of_box = _pose((*box[:3], 0.0, 0.0, 0.0, 1.0, *[0.0] * COVARIANCE_SIZE))
        if not found:
            return Detection(pose=of_box, id=track or None)
        name, (score, *numbers) = max(found, key=lambda one: one[1][0])
        pose = _pose(tuple(numbers))
        if pose is None or pose.position_m is None:
            pose = of_box or pose
        return Detection(pose=pose, class_name=name, confidence=score, id=track or None)

    def tag(self) -> Detection:
        """apriltag_msgs/AprilTagDetection, whose corners are counter-clockwise from the lower left one."""
        family = self.text()
        number, _hamming = self.numbers("2i", 4)
        self.numbers("2f", 4)  # goodness, decision_margin
        middle, *corners = np.reshape(self.numbers("19d", 8)[:10], (5, 2))  # and the homography
        lower_left, lower_right, upper_right, upper_left = corners
        points = {
            "center": middle,
            "left": (lower_left + upper_left) / 2,
            "right": (lower_right + upper_right) / 2,
        }
        named = {name: DetectedPoint(u_px=float(p[0]), v_px=float(p[1])) for name, p in points.items()}
        return Detection(points=named, class_name=f"{family}:{number}", id=number)

    def camera_info(self) -> dict[str, Any]:
        """sensor_msgs/CameraInfo, by the names of its fields."""
        self.header()
        height, width = self.numbers("2I", 4)
        model = self.text()
        d = self.numbers(f"{self.count(least=8)}d", 8)
        matrices = self.numbers("30d", 8)  # k, r, p
        binning_x, binning_y, x, y, roi_height, roi_width = self.numbers("6I", 4)
        return {
            "height": height,
            "width": width,
            "d": list(d),
            "k": list(matrices[:9]),
            "p": list(matrices[18:]),
            "distortion_model": model or ("" if any(d) else "plumb_bob"),
            "binning_x": binning_x,
            "binning_y": binning_y,
            "roi": {"x_offset": x, "y_offset": y, "height": roi_height, "width": roi_width},
        }
