"""The sink that publishes for ROS 2 nodes that use rmw_zenoh.

A topic's key is `<domain>/<topic>/<type>/<hash>`. Liveliness tokens below `@ros2_lv/<domain>` announce our node
and its publishers: `ros2 node list` and `ros2 topic list` read them. A message's attachment has 33 bytes: its
number and the time of publication (64 bits each, little-endian), and the publisher's id (16 bytes) behind its
length. So writes rmw_zenoh of Humble, Kilted and later, and of Jazzy from its version 0.2.4 on.
"""

import hashlib
import struct
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count
from typing import Any, Final, NamedTuple, Protocol

from onboard.messages import Health
from onboard.messages.ros import Ros2Config, RosMessage, RosTopic
from onboard.sinks.sink import SinkError, SinkRunner
from onboard.sinks.zenoh_session import ZenohSession

ROS_CAPACITY: Final = 1024  # records
NODE: Final = "onboard"
NO_TYPE_HASH: Final = "TypeHashNotSupported"  # Humble has none
QOS: Final = "1:2:1,10:,:,:,,"  # reliable, volatile, the last 10; no deadline, lifespan or lease
ATTACHMENT: Final = struct.Struct("<qqB16s")
ID_SIZE: Final = 16

Stamped = tuple[Any, int]  # a record, and the time in its headers: Unix time, ns
Encode = Callable[[Any, int], Iterable[RosMessage]]


class _Publisher(NamedTuple):
    zenoh: Any
    token: Any
    identity: bytes
    numbers: Iterator[int]  # of its messages: a gap is a message that was lost


class RosSink:
    """A sink that publishes on a session opened and closed elsewhere.

    `encode` converts a record to messages.
    """

    def __init__(
        self,
        session: ZenohSession,
        config: Ros2Config,
        encode: Encode,
        *,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._session, self._config, self._encode, self._now_ns = session, config, encode, now_ns
        self._root = f"@ros2_lv/{config.domain}/{session.zid()}/0"
        self._node: Any = None
        self._publishers: dict[str, _Publisher] = {}

    def open(self) -> None:
        """Announce our node. Raises SinkError if the session is closed."""
        if self._session.is_closed():
            raise SinkError("ros2: the Zenoh session is closed")
        self._node = self._session.liveliness().declare_token(f"{self._root}/0/NN/%/%/{NODE}")

    def write(self, records: Sequence[Stamped]) -> None:
        """Publish the messages of each record."""
        for record, t_ns in records:
            for message in self._encode(record, t_ns):
                topic = message.topic
                publisher = self._publishers.get(topic.name) or self._declare(topic)
                number = next(publisher.numbers)
                attachment = ATTACHMENT.pack(number, self._now_ns(), ID_SIZE, publisher.identity)
                publisher.zenoh.put(message.data, attachment=attachment)

    def close(self) -> None:
        """Withdraw publishers and node."""
        declared = [thing for publisher in self._publishers.values() for thing in publisher[:2]]
        declared += [] if self._node is None else [self._node]
        self._publishers, self._node = {}, None
        if not self._session.is_closed():
            for thing in declared:
                thing.undeclare()

    def _declare(self, topic: RosTopic) -> _Publisher:
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        kind = dds_name(topic.kind)
        type_hash = NO_TYPE_HASH if self._config.distribution == "humble" else topic.type_hash
        key = f"{self._config.domain}/{topic.name.strip('/')}/{kind}/{type_hash}"
        drop = zenoh.CongestionControl.DROP
        publisher = self._session.declare_publisher(key, congestion_control=drop, express=True)
        name = topic.name.replace("/", "%")
        number = len(self._publishers) + 1
        announced = f"{self._root}/{number}/MP/%/%/{NODE}/{name}/{kind}/{type_hash}/{QOS}"
        token = self._session.liveliness().declare_token(announced)
        identity = hashlib.blake2b(announced.encode(), digest_size=ID_SIZE).digest()
        made = self._publishers[topic.name] = _Publisher(publisher, token, identity, count(1))
        return made


def dds_name(kind: str) -> str:
    """Return a type such as `nav_msgs/msg/Odometry` as rmw_zenoh names it.

    That is `nav_msgs::msg::dds_::Odometry_`.
    """
    package, middle, name = kind.split("/")
    return f"{package}::{middle}::dds_::{name}_"


class Steps(Protocol):
    """A clock that is never set, with the wall clock's offset."""

    def step_ns(self) -> int:
        """The wall clock minus this one."""


class RosRunner(SinkRunner[Stamped]):
    """The sink with its queue; records are stamped when they are queued.

    `wall_ns` is the wall clock, ns; `offset_ns` is `clock` minus the boot clock, None while unknown.
    """

    def __init__(
        self, sink: RosSink, wall_ns: Callable[[], int], offset_ns: Callable[[], int | None], clock: Steps
    ) -> None:
        super().__init__("ros2", sink, ROS_CAPACITY)
        self._wall_ns, self._offset_ns, self._clock = wall_ns, offset_ns, clock

    def put(self, record: Any) -> None:
        """Queue a record; health is stamped now, so that it is also published without an autopilot."""
        if isinstance(record, Health):
            super().put((record, self._wall_ns()))
        elif (offset_ns := self._offset_ns()) is not None and record.t_ns > 0:
            super().put((record, record.t_ns + offset_ns + self._clock.step_ns()))
