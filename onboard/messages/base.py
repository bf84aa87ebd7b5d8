"""Record and Message, of which all others are made, and bytes as they come on a link."""

from enum import StrEnum
from typing import Annotated

import msgspec

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
ImagePoint = tuple[float, float]
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all boundary records."""


class Clock(StrEnum):
    """Which clock stamped a message."""

    BOOT = "boot"  # the autopilot's time since boot
    HOST = "host"  # this computer's clock, the one that also stamps arrivals
    NONE = "none"  # not stamped: true when it arrived, as nearly as we know


class Encoding(StrEnum):
    """How a link's bytes are to be read."""

    MAVLINK = "mavlink"  # whole MAVLink frames in each datagram (UDP, .tlog)
    MAVLINK_STREAM = "mavlink_stream"  # MAVLink frames cut anywhere (TCP, serial)
    POINTS = "points"  # one JSON `CameraPoints` (Zenoh)
    RADAR = "radar"  # one JSON `RadarDetections` (Zenoh)
    RANGES = "ranges"  # one JSON `Pseudoranges` (Zenoh)


class Datagram(Record, frozen=True, kw_only=True):
    """Bytes as they arrived on a link; what a recording holds."""

    channel: str
    encoding: Encoding
    t_recv_ns: int
    data: bytes


class Message(Record, frozen=True, kw_only=True):
    """What every decoded message carries: its times and its sender."""

    t_ns: int
    t_recv_ns: int
    clock: Clock = Clock.BOOT
    system: int = 1
    component: int = 1
