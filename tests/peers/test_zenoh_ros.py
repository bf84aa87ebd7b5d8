"""ROS 2 out, as a stranger sees it: a plain Zenoh subscriber, zenoh's own reader of attachments, rosbags' decoder,
and the daemon as a process."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh
from zenoh.ext import Int64, z_deserialize

from onboard.messages.ros import Ros2Config
from onboard.sinks.sink import SinkError
from onboard.sinks.zenoh_ros import RosRunner, RosSink
from onboard.wire.ros.messages import RosEncoder
from tests.support.daemon import Setup
from tests.support.programs import until
from tests.support.vehicle_records import nav_state
from tests.unit.wire.test_ros_diagnostics import health

pytest.importorskip("rosbags", reason="needs the extra `ros2`")
ODOMETRY = "nav_msgs::msg::dds_::Odometry_"
HASH = "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"
NOW = 1_795_212_000_000_000_000


def connected(endpoint: str) -> Any:
    text = (
        f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}, scouting: {{multicast: {{enabled: false}}}}}}'
    )
    return zenoh.open(zenoh.Config.from_json5(text))


@pytest.fixture
def client(session: Any, endpoint: str) -> Iterator[Any]:  # noqa: ARG001 - the router must be there first
    opened = connected(endpoint)
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def encoder() -> RosEncoder:
    return RosEncoder(Ros2Config())


def sink(session: Any, encoder: RosEncoder, **config: Any) -> RosSink:
    made = RosSink(session, Ros2Config(**config), encoder.encode, now_ns=lambda: NOW)
    made.open()
    return made


def received(client: Any, key: str, ros: RosSink, count: int) -> list[Any]:
    """The first samples under a key, while a sink publishes our own state again and again."""
    samples: list[Any] = []
    subscriber = client.declare_subscriber(key, samples.append)

    def publish() -> bool:
        ros.write([(nav_state(), NOW)])
        return len(samples) >= count

    until(publish, key)
    subscriber.undeclare()
    return samples


def test_a_plain_subscriber_decodes_the_message_and_its_attachment(
    session: Any, client: Any, encoder: RosEncoder
) -> None:
    ros = sink(session, encoder, domain=7)
    key = f"7/onboard/odometry/{ODOMETRY}/{HASH}"  # what a ROS 2 node of domain 7 subscribes to
    samples = received(client, key, ros, 3)
    first = None
    for k, sample in enumerate(samples):
        assert str(sample.key_expr) == key
        m = encoder.store.deserialize_cdr(sample.payload.to_bytes(), "nav_msgs/msg/Odometry")
        assert (m.child_frame_id, m.pose.pose.position.z) == ("base_link", 3.0)
        assert m.header.stamp.sec == NOW // 10**9
        number, t_ns, identity = z_deserialize(tuple[Int64, Int64, bytes], sample.attachment)
        first = first or int(number)
        assert (int(number), int(t_ns), len(identity)) == (first + k, NOW, 16)
        assert len(sample.attachment.to_bytes()) == 33
    ros.close()


def test_humble_has_no_hashes_of_types(session: Any, client: Any, encoder: RosEncoder) -> None:
    ros = sink(session, encoder, distribution="humble")
    assert received(client, f"0/onboard/odometry/{ODOMETRY}/TypeHashNotSupported", ros, 1)
    ros.close()


def tokens(client: Any) -> list[str]:
    return sorted(str(reply.ok.key_expr) for reply in client.liveliness().get("@ros2_lv/**"))


def test_node_and_publishers_are_announced_and_withdrawn(session: Any, client: Any, encoder: RosEncoder) -> None:
    ros = sink(session, encoder)
    ros.write([(nav_state(), NOW), (health(), NOW), (nav_state(), NOW)])
    root = f"@ros2_lv/0/{session.zid()}/0"
    node, odometry, diagnostics = until(lambda: len(found := tokens(client)) == 3 and found, "three tokens")
    assert node == f"{root}/0/NN/%/%/onboard"
    assert odometry == f"{root}/1/MP/%/%/onboard/%onboard%odometry/{ODOMETRY}/{HASH}/1:2:1,10:,:,:,,"
    assert diagnostics.startswith(
        f"{root}/2/MP/%/%/onboard/%diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/"
    )
    ros.close()
    until(lambda: tokens(client) == [], "no tokens")
    ros.open()
    until(lambda: tokens(client) == [node], "the node again")
    ros.close()
    session.close()
    with pytest.raises(SinkError, match="the Zenoh session is closed"):
        ros.open()


def test_two_publishers_count_and_name_themselves_apart(session: Any, client: Any, encoder: RosEncoder) -> None:
    """A subscriber takes a gap in a publisher's numbers for messages that were lost."""
    ros, samples = sink(session, encoder), []
    subscriber = client.declare_subscriber("0/**", samples.append)
    records = [(nav_state(), NOW), (health(), NOW)]

    def publish() -> bool:
        ros.write(records)
        return len(samples) >= 10

    until(publish, "samples of both")
    subscriber.undeclare()
    by_key: dict[str, list[Any]] = {}
    for sample in samples:
        read = z_deserialize(tuple[Int64, Int64, bytes], sample.attachment)
        by_key.setdefault(str(sample.key_expr), []).append(read)
    assert len(by_key) == 2
    for read in by_key.values():
        numbers = [int(number) for number, _, _ in read]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len({bytes(identity) for read in by_key.values() for _, _, identity in read}) == 2
    ros.close()


def test_stamps_are_of_the_wall_clock_and_the_health_needs_no_autopilot(session: Any, encoder: RosEncoder) -> None:
    offset: list[int | None] = [None]
    clock = SimpleNamespace(step_ns=lambda: 3)
    runner = RosRunner(sink(session, encoder), lambda: NOW, lambda: offset[0], clock)
    for record in (nav_state(), health()):
        runner.put(record)
    offset[0] = NOW - 10**10
    runner.put(nav_state())  # at 5 s of the boot clock
    stamps = [t_ns for _, t_ns in runner._queue.take(10, 0.0)]
    assert stamps == [NOW, NOW - 5 * 10**9 + 3]


def test_the_daemon_publishes_what_is_true_now_seed_1(tmp_path: Path, encoder: RosEncoder) -> None:
    setup, read = Setup(tmp_path), dict[str, tuple[int, Any]]()
    links = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none", "--zenoh", setup.endpoint)
    url = f"udpin:127.0.0.1:{setup.autopilot}"

    def take(sample: Any) -> None:
        *topic, kind, _ = str(sample.key_expr).split("/")[1:]
        package, *_, name = kind.rstrip("_").split("::")
        message = encoder.store.deserialize_cdr(sample.payload.to_bytes(), f"{package}/msg/{name}")
        read["/".join(topic)] = time.time_ns(), message

    def is_complete() -> bool:
        _, diagnostics = read.get("diagnostics", (0, None))
        names = {status.name for status in diagnostics.status} if diagnostics is not None else set()
        return len(read) == 6 and {"onboard", "onboard: leader", "onboard: sink ros2"} <= names

    with setup.daemon(url, "ros2.enabled=true", "ros2.frame_prefix='uav1/'") as daemon:
        client = until(lambda: _tried(setup.endpoint), "the daemon's Zenoh")
        client.declare_subscriber("0/**", take)
        with setup.simulator(*links, "--wait", "300"):
            until(is_complete, "six topics")
        client.close()
        assert daemon.end(signal.SIGTERM) == 0
    assert "Traceback" not in daemon.output()
    leader = {f"onboard/{name}" for name in ("detections", "leader/pose", "leader/odometry", "markers")}
    assert set(read) == {"tf", "diagnostics"} | leader
    for t_ns, m in read.values():
        several = getattr(m, "transforms", None) or getattr(m, "markers", None)
        stamp = (several[0] if several else m).header.stamp
        assert abs(t_ns * 1e-9 - stamp.sec - stamp.nanosec * 1e-9) < 5.0  # however busy this computer
    assert read["onboard/leader/pose"][1].header.frame_id == "uav1/base_enu"


def _tried(endpoint: str) -> Any:
    try:
        return connected(endpoint)
    except zenoh.ZError:  # not running yet
        return None
