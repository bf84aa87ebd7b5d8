"""`onboard ros2` as real ROS 2 sees it: rclpy nodes of other programs, over Fast DDS."""

import json
import math
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
import pytest
from msgspec.structs import replace

from onboard.config import load_config
from onboard.messages import Datagram, Encoding, Estimate, Refusal
from onboard.messages.ros import Ros2Config
from onboard.pipeline import Pipeline
from onboard.sinks.zenoh import ZenohSink
from onboard.wire.ros.messages import RosEncoder
from onboard.wire.ros.types import DEFINITIONS
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import EPOCH_NS, datagrams
from tests.support.daemon import Observer, Setup
from tests.support.programs import Program, until
from tests.support.ros2 import CLIENT, lines, ros_program, ros_run, why_absent
from tests.support.vehicle_records import nav_state
from tests.unit.wire.test_ros_diagnostics import health

pytestmark = pytest.mark.skipif(bool(reason := why_absent()), reason=reason)
TOPICS = (
    "/onboard/odometry:nav_msgs/Odometry",
    "/onboard/leader/odometry:nav_msgs/Odometry",
    "/onboard/leader/pose:geometry_msgs/PoseWithCovarianceStamped",
    "/onboard/detections:vision_msgs/Detection3DArray",
    "/onboard/markers:visualization_msgs/MarkerArray:reliable",
    "/diagnostics:diagnostic_msgs/DiagnosticArray:reliable",
    "/tf:tf2_msgs/TFMessage:reliable",
    "/tf_static:tf2_msgs/TFMessage:latched",
)


@contextmanager
def listener(folder: Path, *topics: str) -> Iterator[Program]:
    with ros_program(folder / "listener.log", CLIENT, "listen", *topics) as program:
        program.wait_for("listening")
        yield program


def heard(program: Program) -> dict[str, list[dict[str, Any]]]:
    """What the listener has received, by topic."""
    found: dict[str, list[dict[str, Any]]] = {}
    for line in lines(program.stdout.read_text(encoding="utf-8")):
        found.setdefault(line["topic"], []).append(line)
    return found


def statuses(program: Program) -> dict[str, dict[str, Any]]:
    """The newest status of each name in /diagnostics."""
    arrays = heard(program).get("/diagnostics", [])
    return {status["name"]: status for line in arrays for status in line["message"]["status"]}


def stamp_ns(message: dict[str, Any]) -> int:
    return int(message["header"]["stamp"]["sec"] * 10**9 + message["header"]["stamp"]["nanosec"])


def place(message: dict[str, Any]) -> list[float]:
    return [message["pose"]["pose"]["position"][name] for name in "xyz"]


def test_a_flight_arrives_and_a_restarted_daemon_is_found_again_seed_1(tmp_path: Path) -> None:
    setup = Setup(tmp_path)
    url, sets = f"udpin:127.0.0.1:{setup.autopilot}", ("estimator.own_state={}",)
    links = ("--mavlink", f"udpout:127.0.0.1:{setup.autopilot}", "--tcp", "none", "--zenoh", setup.endpoint)
    command = ("onboard", "ros2", "--config", setup.config, "--set", f"zenoh.connect=['{setup.endpoint}']")
    with listener(tmp_path, *TOPICS) as ears, ros_program(tmp_path / "node.log", *command) as node:
        until(lambda: "onboard: node" in statuses(ears), "diagnostics without a daemon")
        assert statuses(ears)["onboard: node"]["level"] == 2
        assert "no router answers" in statuses(ears)["onboard: node"]["message"]
        with setup.daemon(url, *sets) as daemon:
            observer = Observer(setup.endpoint)
            with setup.simulator(*links, "--wait", "300"):
                until(lambda: len(heard(ears)) == len(TOPICS), "all topics")
                until(lambda: len(heard(ears)["/onboard/leader/odometry"]) >= 30, "a leader")
                until(observer.is_tracking, "an estimate by Zenoh")
                estimates = [e for e in observer.estimates if e.valid and e.name == "leader"]
                check(heard(ears), estimates, observer)
                assert statuses(ears)["onboard: node"]["level"] == 0
                daemon.kill()
                until(lambda: statuses(ears)["onboard: node"]["level"] == 2, "a daemon that is silent")
                before = Counter({topic: len(found) for topic, found in heard(ears).items()})
                with setup.daemon(url, *sets):
                    until(lambda: statuses(ears)["onboard: node"]["level"] == 0, "the daemon again")
                    until(
                        lambda: len(heard(ears)["/onboard/leader/pose"]) > before["/onboard/leader/pose"] + 10,
                        "the leader again",
                    )
            observer.client.close()
        assert node.end(signal.SIGINT) == 0
        assert "Traceback" not in node.output()
        assert node.output().count("no router answers") == 1


def check(read: dict[str, list[dict[str, Any]]], estimates: list[Any], observer: Observer) -> None:
    """Values, frames and stamps are those of the records that the daemon publishes as JSON."""
    offset_ns, compared = observer.newest().clock_offset_ns, 0
    for line in read["/onboard/leader/odometry"]:
        message = line["message"]
        assert (message["header"]["frame_id"], message["child_frame_id"]) == ("base_enu", "leader")
        assert abs(line["t_ns"] - stamp_ns(message)) < 5e9  # however busy this computer
        for estimate in estimates:
            north, east, down, *v = estimate.mean[:6]
            if place(message) == [east, north, -down]:
                assert stamp_ns(message) == pytest.approx(
                    estimate.t_ns + offset_ns, abs=1e7
                )  # it is estimated anew
                linear = message["twist"]["twist"]["linear"]
                assert [linear[name] for name in "xyz"] == [v[1], v[0], -v[2]]
                variance = np.reshape(message["pose"]["covariance"], (6, 6))[0, 0]
                assert variance == estimate.covariance[1][1]
                compared += 1
    assert compared > 3
    own = read["/onboard/odometry"][-1]["message"]
    assert (own["header"]["frame_id"], own["child_frame_id"]) == ("map", "base_link")
    markers = {one["ns"]: one for one in read["/onboard/markers"][-1]["message"]["markers"]}
    assert {"leader", "leader/covariance", "leader/velocity", "leader/label"} <= set(markers)
    assert {one["header"]["frame_id"] for one in markers.values()} == {"base_enu"}
    (static,) = {one["child_frame_id"] for one in read["/tf_static"][-1]["message"]["transforms"]}
    assert static == "front_optical"
    frames = {one["child_frame_id"] for line in read["/tf"] for one in line["message"]["transforms"]}
    assert frames == {"base_enu", "base_link", "leader"}


# ------------------------------------------------------------------------------- a daemon that the test plays


class PlayedDaemon(NamedTuple):
    """What the daemon publishes with, and when the autopilot booted, Unix time in ns."""

    sink: ZenohSink
    boot_ns: int

    def publish(self, later_ms: int = 0, t_ms: int | None = None) -> None:
        """Our own state of a time (None: now), or of later."""
        now_ms = (time.time_ns() - self.boot_ns) // 1_000_000
        self.sink.write([nav_state((now_ms if t_ms is None else t_ms) + later_ms)])


@contextmanager
def played_daemon(session: Any, **changed: Any) -> Iterator[PlayedDaemon]:
    """Publishes a health twice a second; the autopilot has booted a minute before."""
    sink = ZenohSink(session, "onboard/1")
    sink.open()
    boot_ns = time.time_ns() - 60 * 10**9
    ended = threading.Event()

    def live() -> None:
        while not ended.wait(0.5):
            now_ns = time.time_ns()
            fields = {"clock_offset_ns": boot_ns, "uptime": (now_ns - boot_ns) * 1e-9, "t_recv_ns": now_ns}
            sink.write([health(**fields, **changed)])

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield PlayedDaemon(sink, boot_ns)
    finally:
        ended.set()
        thread.join()
        sink.close()


def node_of(folder: Path, endpoint: str, *parameters: str) -> Any:
    words = [word for parameter in (f"endpoint:={endpoint}", *parameters) for word in ("-p", parameter)]
    return ros_program(folder / "node.log", "onboard", "ros2", "--ros-args", *words)


def boxes(flight: list[Datagram]) -> list[dict[str, Any]]:
    """A box around the wing in each image: of the image's time, as a detector would send it."""
    found = []
    for datagram in flight:
        if datagram.encoding is Encoding.POINTS:
            points = json.loads(datagram.data)
            left, center, right = (points[name] for name in ("left", "center", "right"))
            width = abs(right["u_px"] - left["u_px"])
            if width > 2.0:
                box = {"u_px": center["u_px"], "v_px": center["v_px"], "width_px": width, "height_px": 0.2 * width}
                found.append({"t_ns": points["t_ns"] + EPOCH_NS, "t_recv_ns": datagram.t_recv_ns, "box": box})
    return found


def ros_fields(t_ns: int, box: dict[str, float], frame: str = "camera_optical") -> dict[str, Any]:
    sec, nanosec = divmod(t_ns, 10**9)
    header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}
    center = {"position": {"x": box["u_px"], "y": box["v_px"]}}
    one = {
        "results": [{"hypothesis": {"class_id": "drone", "score": 0.75}}],
        "bbox": {"center": center, "size_x": box["width_px"], "size_y": box["height_px"]},
        "id": "7",
    }
    return {"header": header, "detections": [one]}


def line(at: float, kind: str, fields: dict[str, Any], topic: str = "/detector/found") -> str:
    return json.dumps({"at": at, "topic": topic, "type": kind, "fields": fields}) + "\n"


def flown(config: Any, flight: list[Datagram], images: list[Datagram]) -> tuple[list[Estimate], Pipeline]:
    """The leader's estimates of a flight with these images instead of its own."""
    pipeline = Pipeline(config)
    own = [datagram for datagram in flight if datagram.encoding is not Encoding.POINTS]
    sent = sorted([*own, *images], key=lambda datagram: datagram.t_recv_ns)
    outputs = [output for datagram in sent for output in pipeline.feed(datagram)]
    return [o for o in outputs if isinstance(o, Estimate) and o.name == "leader"], pipeline


BOXES = "vision_msgs/Detection2DArray"


def test_detections_give_the_estimates_of_the_same_detections_as_json_seed_1(
    tmp_path: Path, session: Any, endpoint: str
) -> None:
    scenario = load_scenario("formation")
    (tmp_path / "c.toml").write_text(daemon_config(scenario), encoding="utf-8")
    config = load_config(tmp_path / "c.toml", ())
    flight = [one for one in datagrams(scenario, 1, 6.0) if isinstance(one, Datagram)]
    seen = boxes(flight)
    nan, elsewhere = seen[0]["box"] | {"u_px": math.nan}, {"width_px": 1.0, **seen[0]["box"]}
    last = 0.02 * len(seen)
    text = [line(0.02 * k, BOXES, ros_fields(one["t_ns"], one["box"])) for k, one in enumerate(seen)]
    text += [line(last + 0.1, BOXES, ros_fields(seen[-1]["t_ns"] + 1, nan))]
    text += [line(last + 0.2 + 0.02 * k, BOXES, ros_fields(1, elsewhere, "map")) for k in range(5)]
    (tmp_path / "sent.jsonl").write_text("".join(text), encoding="utf-8")
    arrived: list[Any] = []
    session.declare_subscriber(
        "onboard/1/camera/front/ros/**", lambda s: arrived.append((str(s.key_expr), s.payload.to_bytes()))
    )
    refusal = Refusal(source="camera front", reason="too old for us", count=3, t_recv_ns=1)
    parameters = ("front.detections:=/detector/found", "front.frame:=camera_optical")
    with (
        played_daemon(session, refusals=(refusal,)),
        listener(tmp_path, "/diagnostics:diagnostic_msgs/DiagnosticArray:reliable") as ears,
        node_of(tmp_path, endpoint, *parameters) as node,
    ):
        name = "onboard: input /detector/found"
        until(lambda: statuses(ears).get("onboard: node", {}).get("level") == 0, "the node")
        with ros_program(tmp_path / "publisher.log", CLIENT, "publish", tmp_path / "sent.jsonl") as publisher:
            publisher.wait_for("published")
            until(lambda: "`map`" in node.output(), "the wrong frame in the log")
        (tmp_path / "pose.jsonl").write_text(line(0.0, "nav_msgs/Odometry", {}), encoding="utf-8")
        with ros_program(tmp_path / "other.log", CLIENT, "listen", "/detector/found:nav_msgs/Odometry") as other:
            other.wait_for("listening")  # for the publisher to find a subscriber of its type
            with ros_program(tmp_path / "wrong.log", CLIENT, "publish", tmp_path / "pose.jsonl"):
                until(lambda: "nav_msgs/msg/Odometry" in node.output(), "the wrong type in the log")
                until(
                    lambda: statuses(ears)[name]["message"].startswith("a publisher is of"), "and in diagnostics"
                )
        values = {one["key"]: one["value"] for one in statuses(ears)[name]["values"]}
        assert (int(values["forwarded"]), int(values["refused"])) == (len(arrived), 6)
        assert node.output().count("`map`") == node.output().count("nav_msgs/msg/Odometry") == 1
        assert node.output().count("too old for us") == 1  # what the daemon refuses is in ROS's log, too
        assert node.end(signal.SIGINT) == 0
    assert len(arrived) > 100  # sensor data: some may be lost
    by_time = {one["t_ns"]: one for one in seen}
    by_ros, by_json = [], []
    for key, data in arrived:
        t_ns = int.from_bytes(data[4:8], "little") * 10**9 + int.from_bytes(data[8:12], "little")
        t_recv_ns = by_time.get(t_ns, seen[-1])["t_recv_ns"]
        by_ros.append(Datagram(channel=key, encoding=Encoding.ROS, t_recv_ns=t_recv_ns, data=data))
        if t_ns in by_time:
            detection = {"box": by_time[t_ns]["box"], "class": "drone", "confidence": 0.75, "id": "7"}
            document = {"t_ns": t_ns, "clock": "host", "camera": "front", "detections": [detection]}
            channel = "onboard/1/camera/front/detections"
            as_json = Datagram(
                channel=channel,
                encoding=Encoding.DETECTIONS,
                t_recv_ns=t_recv_ns,
                data=json.dumps(document).encode(),
            )
            by_json.append(as_json)
    of_ros, pipeline = flown(config, flight, by_ros)
    of_json, _ = flown(config, flight, by_json)
    assert [replace(one, sequence=0) for one in of_ros] == [replace(one, sequence=0) for one in of_json]
    assert sum(one.valid for one in of_ros) > 50
    (reason,) = [r.reason for r in pipeline.health(flight[-1].t_recv_ns).refusals if "finite" in r.reason]
    assert "`$.detections[0].bbox`" in reason


@pytest.mark.parametrize("seconds", [5, pytest.param(60, marks=pytest.mark.slow)])
def test_a_reliable_subscriber_loses_nothing_of_100_hz(
    tmp_path: Path, session: Any, endpoint: str, seconds: int
) -> None:
    topic = "/onboard/odometry"
    override = f"qos_overrides.{topic}.publisher"
    parameters = (f"{override}.reliability:=reliable", f"{override}.depth:=1000")
    with (
        played_daemon(session) as daemon,
        listener(tmp_path, f"{topic}:nav_msgs/Odometry:reliable") as ears,
        node_of(tmp_path, endpoint, *parameters) as node,
    ):
        until(lambda: daemon.publish() or heard(ears), "a first odometry")
        time.sleep(1.0)  # those on the way
        begin, first, memory = time.monotonic(), len(heard(ears)[topic]), []
        t_ms = (time.time_ns() - daemon.boot_ns) // 1_000_000
        process = psutil.Process(node.popen.pid)
        for k in range(100 * seconds):
            time.sleep(max(begin + 0.01 * k - time.monotonic(), 0.0))
            daemon.publish(t_ms=t_ms + 10 * k)
            if k % 100 == 50:
                memory.append(process.memory_info().rss)
        until(lambda: len(heard(ears)[topic]) >= first + 100 * seconds, "all of them", timeout=60.0)
        stamps = [stamp_ns(one["message"]) for one in heard(ears)[topic]][first:]
        assert {b - a for a, b in pairwise(stamps)} == {10_000_000}
        assert memory[-1] - memory[len(memory) // 3] < 4e6
        assert node.end(signal.SIGTERM) == 0


def test_a_missing_type_and_another_clock_are_named(tmp_path: Path, session: Any, endpoint: str) -> None:
    """A record whose time is of before a reboot of the autopilot is not published with a stamp of tomorrow."""
    topic = "/onboard/odometry"
    with (
        played_daemon(session) as daemon,
        listener(
            tmp_path, f"{topic}:nav_msgs/Odometry", "/diagnostics:diagnostic_msgs/DiagnosticArray:reliable"
        ) as ears,
        node_of(tmp_path, endpoint),
    ):

        def is_counted() -> bool:
            daemon.publish(later_ms=3_600_000)
            values = {
                one["key"]: one["value"] for one in statuses(ears).get("onboard: node", {}).get("values", [])
            }
            return int(values.get("stamps of another clock", 0)) > 3

        until(is_counted, "the count")
        assert topic not in heard(ears)
        until(lambda: daemon.publish() or topic in heard(ears), "one of our clock")


def test_sim_time_is_that_of_clock(tmp_path: Path, session: Any, endpoint: str) -> None:
    """Stamps are the simulation's time: 1000 s at the start."""
    played = [{"t_ns": 10**12 + 10**7 * k, "topic": "", "type": "", "data": ""} for k in range(1000)]
    (tmp_path / "clock.jsonl").write_text("".join(json.dumps(one) + "\n" for one in played), encoding="utf-8")
    topic = "/onboard/odometry"
    with (
        played_daemon(session) as daemon,
        listener(tmp_path, f"{topic}:nav_msgs/Odometry", "--sim") as ears,
        node_of(tmp_path, endpoint, "use_sim_time:=true"),
    ):
        for _ in range(30):
            daemon.publish()
            time.sleep(0.1)
        assert topic not in heard(ears)  # no /clock yet

        def timed() -> list[dict[str, Any]]:
            daemon.publish()
            return [one for one in heard(ears).get(topic, []) if one["clock_ns"]]

        with ros_program(tmp_path / "player.log", CLIENT, "play", tmp_path / "clock.jsonl"):
            until(lambda: len(timed()) > 10, "odometry in the simulation's time")
    # of the same clock, however busy this computer
    found = [one for one in heard(ears)[topic] if one["clock_ns"]]
    assert max(abs(stamp_ns(one["message"]) - one["clock_ns"]) for one in found) < 5e9


# ------------------------------------------------------------------------------- types


def test_hashes_of_types_are_rclpy_s_own() -> None:
    encoder = RosEncoder(Ros2Config())
    kinds = [
        *("nav_msgs/Odometry", "geometry_msgs/PoseWithCovarianceStamped", "visualization_msgs/MarkerArray"),
        *("diagnostic_msgs/DiagnosticArray", "tf2_msgs/TFMessage", "sensor_msgs/CameraInfo"),
        *(f"{package}/{name}" for package, names in DEFINITIONS.items() for name in names),
    ]
    ours = {kind: encoder.store.hash_rihs01(kind.replace("/", "/msg/")) for kind in kinds}
    assert {one["type"]: one["hash"] for one in ros_run("hashes", *kinds)} == ours
