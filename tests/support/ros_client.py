"""A plain rclpy node of another program, run by the Python of the ROS wheels.

`listen TOPIC:TYPE[:reliable|latched] ...` prints each message as a line of JSON; `publish FILE` publishes lines of
JSON (`at`, `topic`, `type`, `fields`), `play BAG_LINES` the bytes of a bag, with /clock; `hashes TYPE ...` prints
rclpy's own hashes of types; `copy` reads lines of a type and bytes, and says whether rclpy writes the same bytes.
"""

import base64
import json
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import deserialize_message, serialize_message

QOS = {
    "": qos_profile_sensor_data,
    "reliable": QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE),
    "latched": QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}


def type_of(kind: str) -> Any:
    package, _, name = kind.partition("/")
    return getattr(import_module(f"{package}.msg"), name)


def tree(value: Any) -> Any:
    """A message as dictionaries and lists."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: tree(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return [tree(item) for item in value] if isinstance(value, list | tuple) else value


def filled(message: Any, fields: dict[str, Any]) -> Any:
    """Return a message with these fields; the name of a field gives the type of a list's messages."""
    kinds = message.get_fields_and_field_types()
    for name, value in fields.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            kind = kinds[name].removeprefix("sequence<").rstrip(">")
            setattr(message, name, [filled(type_of(kind)(), one) for one in value])
        else:
            setattr(message, name, value)
    return message


def listen(node: Any, topics: list[str]) -> None:
    def declare(topic: str, kind: str, qos: str = "") -> None:
        def show(message: Any) -> None:
            clock_ns = node.get_clock().now().nanoseconds
            line = {"topic": topic, "t_ns": time.time_ns(), "clock_ns": clock_ns, "message": tree(message)}
            print(json.dumps(line), flush=True)

        node.create_subscription(type_of(kind), topic, show, QOS[qos])

    for text in topics:
        declare(*text.split(":"))
    print("listening", file=sys.stderr, flush=True)
    rclpy.spin(node)


def publish(node: Any, file: str) -> None:
    lines = [json.loads(line) for line in Path(file).read_text(encoding="utf-8").splitlines()]
    kinds = {line["topic"]: line["type"] for line in lines}
    publishers = {topic: node.create_publisher(type_of(kind), topic, 100) for topic, kind in kinds.items()}
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        time.sleep(0.05)
    begin = time.monotonic()
    for line in lines:
        time.sleep(max(begin + line["at"] - time.monotonic(), 0.0))
        publishers[line["topic"]].publish(filled(type_of(line["type"])(), line["fields"]))
    print("published", file=sys.stderr, flush=True)
    rclpy.spin(node)  # until it is ended: a node finds publishers once a second


def play(node: Any, file: str) -> None:
    """Play a bag like `ros2 bag play --clock`: its bytes on its topics at its times, with /clock."""
    clock_type = type_of("rosgraph_msgs/Clock")
    clock = node.create_publisher(clock_type, "/clock", 10)
    lines = [json.loads(line) for line in Path(file).read_text(encoding="utf-8").splitlines()]
    kinds = {line["topic"]: line["type"] for line in lines if line["topic"]}
    publishers = {topic: node.create_publisher(type_of(kind), topic, 100) for topic, kind in kinds.items()}
    time.sleep(2.0)  # for the listeners to find them
    begin, first_ns = time.monotonic(), lines[0]["t_ns"]
    for line in lines:
        time.sleep(max(begin + (line["t_ns"] - first_ns) * 1e-9 - time.monotonic(), 0.0))
        message = clock_type()
        message.clock.sec, message.clock.nanosec = divmod(line["t_ns"], 10**9)
        clock.publish(message)
        if line["topic"]:
            publishers[line["topic"]].publish(base64.b64decode(line["data"]))
    print("played", file=sys.stderr, flush=True)
    time.sleep(1.0)


def hashes(node: Any, kinds: list[str]) -> None:
    for k, kind in enumerate(kinds):
        node.create_publisher(type_of(kind), f"/hash_{k}", 1)
        (info,) = node.get_publishers_info_by_topic(f"/hash_{k}")
        print(json.dumps({"type": kind, "hash": str(info.topic_type_hash)}), flush=True)


def copy(file: str) -> None:
    for line in Path(file).read_text(encoding="utf-8").splitlines():
        one = json.loads(line)
        data, kind = base64.b64decode(one["data"]), type_of(one["type"])
        message = deserialize_message(data, kind)
        again = serialize_message(message)
        differ = [ours for ours, theirs in zip(data, again, strict=False) if ours != theirs]
        same = len(again) == len(data) and not any(differ)  # Fast CDR leaves anything in bytes of padding, we 0
        same = same and deserialize_message(again, kind) == message
        print(json.dumps({"topic": one["topic"], "same": same, "message": tree(message)}), flush=True)


def main() -> None:
    verb, *arguments = sys.argv[1:]
    if verb == "copy":
        copy(*arguments)
        return
    parameters = ["--ros-args", "-p", "use_sim_time:=true"] if "--sim" in arguments else []
    arguments = [one for one in arguments if one != "--sim"]
    rclpy.init(args=parameters)
    node = rclpy.create_node(f"test_{verb}")
    try:
        if verb in ("listen", "hashes"):
            {"listen": listen, "hashes": hashes}[verb](node, arguments)
        else:
            {"publish": publish, "play": play}[verb](node, *arguments)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
