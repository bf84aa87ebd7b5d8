"""The base records of all messages, and bytes as they arrive on a link."""

from enum import StrEnum
from typing import Annotated, Self

import msgspec

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
ImagePoint = tuple[float, float]
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all boundary records."""


class Clock(StrEnum):
    """The clock that stamped a message."""

    BOOT = "boot"  # the autopilot's time since boot
    HOST = "host"  # this computer's clock, the one that also stamps arrivals
    NONE = "none"  # no stamp: the arrival time is the best estimate


class Encoding(StrEnum):
    """The format of a link's bytes."""

    MAVLINK = "mavlink"  # whole MAVLink frames in each datagram (UDP, .tlog)
    MAVLINK_STREAM = "mavlink_stream"  # MAVLink frames cut anywhere (TCP, serial)
    POINTS = "points"  # one JSON `CameraPoints` (Zenoh)
    DETECTIONS = "detections"  # one JSON `CameraDetections` (Zenoh)
    ROS = "ros"  # one vision_msgs/Detection2DArray in CDR (Zenoh)
    RADAR = "radar"  # one JSON `RadarDetections` (Zenoh)
    RANGES = "ranges"  # one JSON `Pseudoranges` (Zenoh)
    WARM_STATE = "warm_state"  # one JSON `WarmState`: the file of an earlier run


class Datagram(Record, frozen=True, kw_only=True):
    """Bytes as they arrived on a link; recordings contain these. `wall_step_ns`: the wall clock less the clock of
    `t_recv_ns`, which is never set; None where `t_recv_ns` is the wall clock's, or that is not known. `waited_us`:
    how long they then waited in sockets and queues of this program, microseconds, until it took them."""

    channel: str
    encoding: Encoding
    t_recv_ns: int
    data: bytes
    wall_step_ns: int | None = None
    waited_us: int = 0

    @property
    def taken_ns(self) -> int:
        """When the program took them, on the clock of `t_recv_ns`."""
        return self.t_recv_ns + 1_000 * self.waited_us


class Message(Record, frozen=True, kw_only=True):
    """Base of all decoded messages: times, and MAVLink system and component of the sender."""

    t_ns: int
    t_recv_ns: int
    clock: Clock = Clock.BOOT
    system: int = 1
    component: int = 1

    def at(self, t_ns: int) -> Self:
        """The same, true at a time on the boot clock."""
        return msgspec.structs.replace(self, t_ns=t_ns, clock=Clock.BOOT)
