"""A bag of `onboard replay --out flight.ros2` as real ROS 2 has it: the byte layout, and played with /clock."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from onboard.commands.cli import main
from tests.support.programs import until
from tests.support.records import record
from tests.support.ros2 import CLIENT, lines, ros_program, ros_run, why_absent
from tests.support.streams import CIRCLE, Stream

pytestmark = pytest.mark.skipif(bool(reason := why_absent()), reason=reason)
highlevel = pytest.importorskip("rosbags.highlevel", reason="needs the extra `ros2`")


@pytest.fixture(scope="module")
def bag_lines(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The messages of a replayed flight as lines: topic, type, time and bytes."""
    folder = tmp_path_factory.mktemp("bag")
    record(folder / "flight.mcap", Stream(t1=9.0).datagrams())
    sets = ("--set", "estimator.leader.size_prior_m=2.0")
    assert main(["replay", str(folder / "flight.mcap"), *sets, "--out", str(folder / "flight.ros2")]) == 0
    with highlevel.AnyReader([folder / "flight.ros2"]) as bag, (folder / "bag.jsonl").open("w") as file:
        for connection, t_ns, data in bag.messages():
            kind = connection.msgtype.replace("/msg/", "/")
            text = base64.b64encode(data).decode()
            file.write(json.dumps({"topic": connection.topic, "type": kind, "t_ns": t_ns, "data": text}) + "\n")
    return folder / "bag.jsonl"


def test_rclpy_writes_the_same_bytes_as_the_bag_has(bag_lines: Path) -> None:
    read = ros_run("copy", bag_lines)
    assert len(read) == len(bag_lines.read_text(encoding="utf-8").splitlines()) > 500
    assert {one["topic"] for one in read} >= {
        *("/tf", "/diagnostics", "/onboard/detections", "/onboard/markers"),
        *("/onboard/leader/pose", "/onboard/leader/odometry"),
    }
    assert {one["topic"] for one in read if not one["same"]} == set()
    *_, last = (one["message"] for one in read if one["topic"] == "/onboard/leader/odometry")
    stamp = last["header"]["stamp"]
    (north, east, down), (v_north, v_east, v_down) = CIRCLE.relative(stamp["sec"] + 1e-9 * stamp["nanosec"])
    position, speed = last["pose"]["pose"]["position"], last["twist"]["twist"]["linear"]
    assert [position[name] for name in "xyz"] == pytest.approx([east, north, -down], abs=4.0)
    assert [speed[name] for name in "xyz"] == pytest.approx([v_east, v_north, -v_down], abs=3.0)
    assert np.isfinite(last["pose"]["covariance"]).all()


def test_a_listener_s_clock_is_that_of_a_bag_that_is_played(bag_lines: Path, tmp_path: Path) -> None:
    topic = "/onboard/leader/pose"
    command = (CLIENT, "listen", f"{topic}:geometry_msgs/PoseWithCovarianceStamped", "--sim")
    with ros_program(tmp_path / "listener.log", *command) as ears:
        ears.wait_for("listening")
        with ros_program(tmp_path / "player.log", CLIENT, "play", bag_lines) as player:
            player.wait_for("played")
            until(lambda: lines(ears.stdout.read_text(encoding="utf-8")), "poses")
    found = [one for one in lines(ears.stdout.read_text(encoding="utf-8")) if one["clock_ns"]]
    assert len(found) > 10
    for one in found:
        stamp = one["message"]["header"]["stamp"]
        t_ns = stamp["sec"] * 10**9 + stamp["nanosec"]
        assert 0 < t_ns < 10 * 10**9  # the boot clock of the autopilot
        assert abs(one["clock_ns"] - t_ns) < 3e9  # however busy this computer
