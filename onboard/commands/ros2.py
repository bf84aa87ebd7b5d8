"""`onboard ros2`: a ROS 2 node beside the daemon, for whichever RMW the user runs.

The daemon's records become messages by the table of bags and rmw_zenoh (`onboard.wire.ros.messages`), and rclpy
publishes the bytes. Messages of the cameras go to the daemon as the bytes that came, which it decodes and records.
Needs rclpy, from an installation of ROS 2, and the extra `ros2`.
"""

import argparse
import struct
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from typing import Any, Final, NamedTuple

import msgspec

from onboard import UserError
from onboard.config import Config, load_config
from onboard.messages import Health
from onboard.messages.ros import Ros2Config, RosMessage
from onboard.messages.text import plain
from onboard.sinks.sink import SinkError
from onboard.units import NS_PER_S
from onboard.view.client import Client, PublishedRecord
from onboard.wire.ros.diagnostics import ERROR, OK, WARN, Status
from onboard.wire.ros.messages import RosEncoder
from onboard.wire.ros.received import CAMERA_INFO
from onboard.wire.ros.types import MISSING, full_name

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
NODE: Final = "onboard"
GLOBAL_TOPICS: Final = ("/tf", "/tf_static", "/diagnostics")  # all others are below the node's namespace
TF_DEPTH: Final = 100  # as tf2's own broadcasters
TAKE_TIMEOUT_S: Final = 0.2  # until Ctrl-C is noticed at most
RETRY_PERIOD_S: Final = 0.5  # between attempts to reach a daemon
REPORT_PERIOD_S: Final = 1.0  # between diagnostics
SILENCE_TIMEOUT_S: Final = 3.0  # without a health, which the daemon publishes once a second
MAX_NAMED_COUNT: Final = 64  # different refusals that are logged, each once
# Between a record's stamp and its publication. After a reboot of the autopilot, the offset of its clock is wrong
# until the next health.
MAX_STAMP_AGE_NS: Final = 5 * NS_PER_S
HEADER_SIZE: Final = 16  # bytes up to the frame_id: CDR's own, the stamp, the length of the frame_id


class CameraTopics(NamedTuple):
    """Parameters of one camera: the topic and type of its detections, the topic of its CameraInfo, and the
    frame_id that its messages must have ("": any)."""

    detections: str
    type: str
    camera_info: str
    frame: str


def main(arguments: argparse.Namespace) -> int:
    """Run the node until Ctrl-C. Raises UserError."""
    config = load_config(arguments.config, tuple(arguments.set))
    try:
        import rclpy  # noqa: PLC0415 - of an installation of ROS 2
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor  # noqa: PLC0415
    except ImportError as error:
        raise UserError(
            f"ros2: no rclpy here ({error}): source ROS's setup.bash, or install its wheels"
        ) from error
    rclpy.init(args=["--ros-args", *arguments.ros_args] if arguments.ros_args else [])
    try:
        node = RosNode(rclpy.create_node(NODE), config, has_mounts=arguments.config is not None)
        executor = SingleThreadedExecutor()
        executor.add_node(node.ros)

        def spin() -> None:
            with suppress(ExternalShutdownException):
                while rclpy.ok():
                    executor.spin_once(timeout_sec=TAKE_TIMEOUT_S)  # `spin` may miss the end and wait forever

        thread = threading.Thread(target=spin, name="rclpy")
        thread.start()
        try:
            while rclpy.ok():
                node.step()
        except KeyboardInterrupt:
            pass
        except Exception:  # of any kind: rclpy has ended while a message was being published
            if rclpy.ok():
                raise
        finally:
            node.close()
            rclpy.try_shutdown()
            thread.join()
            node.ros.destroy_node()
    finally:
        rclpy.try_shutdown()
    return 0


class RosNode:
    """Publishes what a daemon publishes, and sends it what cameras publish. `ros` is rclpy's node, which another
    thread spins. `has_mounts`: `config` is the daemon's, so that it has the mounts of the cameras."""

    def __init__(self, ros: Any, config: Config, *, has_mounts: bool = False) -> None:
        self.ros, self._zenoh = ros, config.zenoh
        self._vehicle = str(self._parameter("vehicle", config.zenoh.vehicle))
        self._endpoint = str(self._parameter("endpoint", next(iter(config.zenoh.connect), DEFAULT_ENDPOINT)))
        settings = {
            name: self._parameter(name, getattr(config.ros2, name)) for name in ("namespace", "frame_prefix", "tf")
        }
        rate_hz, depth = self._parameter("rate_hz", 0.0), self._parameter("depth", 10)
        try:
            self._encoder = RosEncoder(msgspec.convert(settings, Ros2Config), float(rate_hz) or None)
            self._depth = msgspec.convert(depth, int)
        except ImportError as error:
            raise UserError(f"ros2: {MISSING} ({error})") from error
        except (ValueError, TypeError) as error:
            raise UserError(f"ros2: a parameter cannot be used: {error}") from error
        self._publishers: dict[str, Any] = {}
        self._absent: dict[str, str] = {}  # topics whose type is not installed, with the remedy
        self._client: Client | None = None
        self._health: Health | None = None
        self._heard_s = self._reported_s = time.monotonic()
        self._trouble = ""  # as logged last
        self._late = 0  # records whose stamp is of another clock
        self._named: set[tuple[str, str]] = set()
        self._inputs = [one for camera in config.camera_inputs().values() for one in self._inputs_of(camera)]
        if has_mounts and settings["tf"] != "none":
            self._publish(self._encoder.encode_mounts(config.camera_model(), time.time_ns()))

    def step(self) -> None:
        """Publish the next record, if one comes soon, and the diagnostics, if they are due."""
        self._client = self._client or self._connected()
        received = None if self._client is None else self._client.take(TAKE_TIMEOUT_S)
        if received is not None:
            self._take(received)
        now_s = time.monotonic()
        if now_s - self._reported_s >= REPORT_PERIOD_S:
            self._reported_s = now_s
            self._report(now_s)

    def close(self) -> None:
        """End the connection to the daemon."""
        if self._client is not None:
            self._client.close()

    def is_silent(self) -> bool:
        """Whether no daemon has been heard for seconds."""
        return self._health is None or time.monotonic() - self._heard_s > SILENCE_TIMEOUT_S

    def send(self, key: str, data: bytes) -> None:
        """Send the daemon a message of a camera; any thread may."""
        if self._client is not None:
            self._client.put(f"onboard/{self._vehicle}/{key}", data)

    def sim_offset_ns(self) -> int | None:
        """ROS's time less this computer's: 0 without `use_sim_time`, None before the first /clock."""
        if not self.ros.get_parameter("use_sim_time").value:
            return 0
        now_ns = int(self.ros.get_clock().now().nanoseconds)
        return now_ns - time.time_ns() if now_ns else None

    # ------------------------------------------------------------------------------- set-up

    def _parameter(self, name: str, default: Any) -> Any:
        """A parameter. Its type is free: on the command line, `vehicle:=1` is a number."""
        from rcl_interfaces.msg import ParameterDescriptor  # noqa: PLC0415 - of an installation of ROS 2

        return self.ros.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value

    def _inputs_of(self, camera: Any) -> Iterable["RosInput"]:
        """Subscriptions to the topics of a camera."""
        defaults = CameraTopics(camera.ros.seen, camera.ros.kind, camera.ros.info, "")
        topics = CameraTopics(
            *(str(self._parameter(f"{camera.name}.{name}", value)) for name, value in defaults._asdict().items())
        )
        key = f"camera/{camera.name}/ros"
        info = RosInput(self, topics.camera_info, CAMERA_INFO, key) if topics.camera_info else None
        if info is not None:
            yield info
        if topics.detections:
            yield RosInput(self, topics.detections, topics.type, key, frame=topics.frame, info=info)

    def _connected(self) -> Client | None:
        try:
            return Client(self._endpoint, self._vehicle, self._zenoh)
        except SinkError as error:
            self._log_trouble(str(error))
            time.sleep(RETRY_PERIOD_S)
            return None

    # ------------------------------------------------------------------------------- out

    def _take(self, received: PublishedRecord) -> None:
        """Publish one record."""
        record, published_ns = received.record, received.t_publish_ns or time.time_ns()
        if isinstance(record, Health):
            self._hear(record)
        sim_ns, t_ns = self.sim_offset_ns(), self._unix_ns(record, published_ns)
        if t_ns is None or sim_ns is None:
            return
        if abs(published_ns - t_ns) > MAX_STAMP_AGE_NS:
            self._late += 1
            return
        for message in self._encoder.encode(record, t_ns + sim_ns):
            self._publish(message)

    def _unix_ns(self, record: Any, published_ns: int) -> int | None:
        """The time of a record as Unix time, None while the daemon does not know the autopilot's clock."""
        if isinstance(record, Health):
            return published_ns
        health = self._health
        if health is None or health.clock_offset_ns is None or record.t_ns <= 0:
            return None
        return int(record.t_ns) + health.clock_offset_ns + health.wall_step_ns

    def _hear(self, health: Health) -> None:
        """Note that the daemon runs; one that has started anew has no CameraInfo yet."""
        if self._health is None or health.uptime < self._health.uptime:
            for one in self._inputs:
                one.send_again()
        self._health, self._heard_s = health, time.monotonic()
        for refusal in health.refusals:
            if any(one.is_source(refusal.source) for one in self._inputs):
                self.warn_once(refusal.source, refusal.reason)

    def _publish(self, message: RosMessage) -> None:
        name = message.topic.name
        if name not in self._publishers:
            self._publishers[name] = self._publisher(name, message.topic.kind)
        if (publisher := self._publishers[name]) is not None:
            publisher.publish(message.data)

    def _publisher(self, name: str, kind: str) -> Any:
        """A publisher, None where the type is not installed."""
        from rclpy.qos_overriding_options import QoSOverridingOptions  # noqa: PLC0415 - of an installation of ROS 2

        try:
            message_type = type_of(kind)
        except (ImportError, AttributeError):
            package = kind.partition("/")[0].replace("_", "-")
            self._absent[name] = f"not published: install ros-$ROS_DISTRO-{package}"
            self.warn_once(name, self._absent[name])
            return None
        overrides = QoSOverridingOptions.with_default_policies()
        relative = name if name in GLOBAL_TOPICS else name[1:]
        return self.ros.create_publisher(
            message_type, relative, qos_of(name, self._depth), qos_overriding_options=overrides
        )

    # ------------------------------------------------------------------------------- diagnostics

    def _report(self, now_s: float) -> None:
        """Publish how this node and its inputs are."""
        silent = self.is_silent()
        counts = {
            "stamps of another clock": str(self._late),
            "unreadable": str(self._client.unread if self._client else 0),
        }
        if silent:
            self._log_trouble(f"no daemon of vehicle {self._vehicle} at {self._endpoint} is heard")
        elif self._trouble:
            self._trouble = ""
            self.ros.get_logger().info("the daemon is heard")
        message = self._trouble if silent else "the daemon is heard"
        if self._health is not None:
            counts["seconds since the last health"] = f"{now_s - self._heard_s:.1f}"
        level = ERROR if silent else WARN if self._absent else OK
        found = [
            Status(level, "onboard: node", message, counts | self._absent),
            *(one.status() for one in self._inputs),
        ]
        sim_ns = self.sim_offset_ns()
        if sim_ns is not None:
            self._publish(self._encoder.encode_diagnostics(found, NODE, time.time_ns() + sim_ns))

    def _log_trouble(self, words: str) -> None:
        if not self._trouble:
            self._trouble = words
            self.ros.get_logger().warning(f"{words}; trying again")

    def warn_once(self, source: str, words: str) -> None:
        """Log a refusal, if it is a new one; any thread may."""
        if (source, words) not in self._named and len(self._named) < MAX_NAMED_COUNT:
            self._named.add((source, words))
            self.ros.get_logger().warning(f"{source}: {words}")


class RosInput:
    """Subscription to one topic of a camera. What it refuses is logged once, counted and in the diagnostics.
    `info`: that of the camera's CameraInfo, which must come first. rclpy's thread calls it."""

    def __init__(
        self, node: RosNode, topic: str, kind: str, key: str, *, frame: str = "", info: "RosInput | None" = None
    ) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data  # noqa: PLC0415

        self._node, self._kind, self._key, self._frame, self._info = node, kind, f"{key}/{kind}", frame, info
        self._source = f"camera {key.split('/')[1]}"
        self._forwarded = self._refused = self._reported = 0
        self._why, self._last = "", b""
        self._wrong: dict[str, str] = {}  # publishers of another type, by id
        try:
            message_type = type_of(full_name(kind))
        except (ImportError, AttributeError, ValueError) as error:
            raise UserError(f"ros2: type {kind} of topic {topic} is not installed ({error})") from error
        profiles = [qos_profile_sensor_data]  # which any publisher offers
        if kind == CAMERA_INFO:  # a publisher that keeps its last one sends it to such a subscription only
            profiles.append(QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        subscribe: Callable[..., Any] = node.ros.create_subscription
        self._subscriptions = [subscribe(message_type, topic, self._receive, qos, raw=True) for qos in profiles]
        self.topic = str(self._subscriptions[0].topic_name)

    def send_again(self) -> None:
        """Send the last CameraInfo to a daemon that has none."""
        if self._kind == CAMERA_INFO and self._last:
            self._node.send(self._key, self._last)

    def has_come(self) -> bool:
        """Whether a message has come."""
        return bool(self._last)

    def is_source(self, source: str) -> bool:
        """Whether the daemon names this camera by `source`."""
        return source == self._source or self._key in source

    def status(self) -> Status:
        """Return the camera's state for the diagnostics."""
        for one in self._node.ros.get_publishers_info_by_topic(self.topic):
            identity = bytes(one.endpoint_gid).hex()
            if one.topic_type != full_name(self._kind) and identity not in self._wrong:
                self._wrong[identity] = one.topic_type
                self._refuse(f"a publisher is of {one.topic_type}; expected {full_name(self._kind)}")
        is_new, self._reported = self._refused > self._reported, self._refused
        values = {"forwarded": str(self._forwarded), "refused": str(self._refused), "last refusal": self._why}
        message = self._why if is_new else "receiving" if self._forwarded else self._why or "nothing received"
        level = WARN if is_new or not self._forwarded else OK
        return Status(level, f"onboard: input {self.topic}", message, values)

    def _receive(self, data: bytes) -> None:
        """Send one message to the daemon."""
        self._last = data
        offset_ns = self._node.sim_offset_ns()
        order = "<" if data[1] & 1 else ">"
        sec, nanosec, length = struct.unpack_from(f"{order}iII", data, 4)
        frame = plain(data[HEADER_SIZE : HEADER_SIZE + length - 1].decode("utf-8", "replace"))
        if self._node.is_silent():
            self._refuse("no daemon is heard")
        elif offset_ns is None:
            self._refuse("use_sim_time is set, and no /clock has come")
        elif self._info is not None and not self._info.has_come():
            self._refuse(f"no CameraInfo has come on {self._info.topic}")
        elif self._frame and frame != self._frame:
            self._refuse(f"`header.frame_id` is `{frame}`; expected `{self._frame}`")
        else:
            sec, nanosec = divmod(sec * NS_PER_S + nanosec - offset_ns, NS_PER_S)
            self._forwarded += 1
            self._node.send(self._key, data[:4] + struct.pack(f"{order}iI", sec, nanosec) + data[12:])

    def _refuse(self, words: str) -> None:
        self._refused += 1
        self._why = words
        self._node.warn_once(self.topic, words)


def type_of(kind: str) -> Any:
    """The class of `package/msg/Name`. Raises ImportError or AttributeError where it is not installed."""
    package, _, name = kind.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), name)


def qos_of(topic: str, depth: int) -> Any:
    """The QoS that subscribers of a topic expect: sensor data for estimates."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: PLC0415 - of ROS 2

    if topic == "/tf_static":
        return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    if topic == "/tf":
        return QoSProfile(depth=TF_DEPTH)
    if topic == "/diagnostics" or topic.endswith("/markers"):
        return QoSProfile(depth=depth)
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
