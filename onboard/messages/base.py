"""Base records of all messages, and bytes as they arrive on a link."""

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
    """Bytes as they arrived on a link; recordings contain these.

    Attributes
    ----------
    t_recv_ns
        Arrival time.
    wall_step_ns
        Wall clock minus the monotonic clock of `t_recv_ns`; None if `t_recv_ns` is the wall clock's own, or if the
        difference is unknown.
    waited_us
        Time that the bytes spent in sockets and queues before the program read them, in microseconds.
    """

    channel: str
    encoding: Encoding
    t_recv_ns: int
    data: bytes
    wall_step_ns: int | None = None
    waited_us: int = 0

    @property
    def read_ns(self) -> int:
        """Time at which the program read the bytes, on the clock of `t_recv_ns`."""
        return self.t_recv_ns + 1_000 * self.waited_us


class Message(Record, frozen=True, kw_only=True):
    """Base of all decoded messages.

    Attributes
    ----------
    t_ns
        Time at which the content was true, on `clock`.
    t_recv_ns
        Arrival time on this computer's clock.
    system, component
        MAVLink identity of the sender.
    """

    t_ns: int
    t_recv_ns: int
    clock: Clock = Clock.BOOT
    system: int = 1
    component: int = 1

    def at(self, t_ns: int) -> Self:
        """Return the same message, true at a time on the boot clock."""
        return msgspec.structs.replace(self, t_ns=t_ns, clock=Clock.BOOT)
