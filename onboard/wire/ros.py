"""ROS 2's vision_msgs/Detection2DArray as rmw_zenoh carries it: CDR, in the publisher's byte order.

A message begins with four bytes that say the byte order (0x00 0x01: little-endian). Numbers are aligned to their
own size from there on; strings and sequences begin with a count of 32 bits, and strings end in NUL (OMG's Common
Data Representation, version 1). The fields are those of vision_msgs 4, which came with ROS 2 Humble.
"""

import math
import struct
from typing import Any, Final, TypeVar

from onboard.messages import Box, CameraDetections, Clock, Detection
from onboard.wire.document import LARGEST, LATEST_NS, BadDocumentError

TYPE: Final = "vision_msgs::msg::dds_::Detection2DArray_"  # in the key of rmw_zenoh: domain/topic/type/hash
ORDERS: Final = {b"\0\0": ">", b"\0\1": "<"}
COVARIANCE: Final = 36
T = TypeVar("T")


def decode_ros(data: bytes) -> CameraDetections:
    """The detections of one message: a box each, with the class and score of its best hypothesis.

    Raises BadDocumentError for bytes that are no such message.
    """
    if len(data) > LARGEST:
        raise BadDocumentError(f"the message has more than {LARGEST} bytes")
    order = ORDERS.get(data[:2])
    if order is None or len(data) < 4:
        raise BadDocumentError("it is not CDR: expected 00 00 or 00 01 in its first bytes")
    reader = _Reader(data[4:], order)
    t_ns, _ = reader.header()
    count = reader.count(least=4)
    detections = tuple(reader.detection(f"detections[{i}]") for i in range(count))
    if not 0 < t_ns < LATEST_NS:
        raise BadDocumentError("`header.stamp` is not set; expected the time of exposure")
    return CameraDetections(t_ns=t_ns, clock=Clock.HOST, detections=detections)


class _Reader:
    """Fields one after the other."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data, self._order, self._at = data, order, 0

    def numbers(self, form: str, size: int) -> tuple[Any, ...]:
        """Numbers of one size, aligned. Raises BadDocumentError beyond the end."""
        at = -(-self._at // size) * size
        layout = struct.Struct(self._order + form)
        if at + layout.size > len(self._data):
            raise BadDocumentError(f"the message ends after {len(self._data)} bytes; {TYPE[:-1]} is longer")
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
        return sec * 1_000_000_000 + nanosec, self.text()

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
        """vision_msgs/ObjectHypothesisWithPose: class_id and score; the pose is not used."""
        name = self.text()
        score, *_ = self.numbers(f"{1 + 7 + COVARIANCE}d", 8)
        return name, score
