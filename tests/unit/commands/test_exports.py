"""What a replay exports, read back by others: pyarrow, evo, mcap with Foxglove's schemas, and rosbags."""

import csv
import io
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from onboard import UserError
from onboard.analysis.exports.csv_rows import OWN_TABLE, CsvWriter
from onboard.analysis.exports.tables import check_exports
from onboard.commands.cli import main
from tests.support.dataflash import dataflash
from tests.support.records import record
from tests.support.streams import CIRCLE, Stream, write_truth
from tests.support.vehicle_records import nav_state

SIZE = ("--set", "estimator.leader.size_prior_m=2.0")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight and all that can be exported of it."""
    folder = tmp_path_factory.mktemp("exports")
    record(folder / "flight.mcap", Stream(t1=14.0).datagrams())
    write_truth(folder / "truth.csv", CIRCLE, np.arange(5.0, 14.0, 0.04).tolist())
    outs = [
        word
        for kind in ("csv", "parquet", "tum", "mcap", "ros2")
        for word in ("--out", str(folder / f"leader.{kind}"))
    ]
    call = ["replay", str(folder / "flight.mcap"), *SIZE, *outs, "--truth", str(folder / "truth.csv")]
    assert main(call) == 0
    return folder


def test_parquet_is_the_csv_with_all_digits(exported: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow: the extra `parquet`")
    table = parquet.read_table(exported / "leader.parquet")
    with (exported / "leader.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert table.column_names == list(rows[0])
    assert table.num_rows == len(rows) > 250
    for name in ("r_north_m", "sigma_r_north_m", "nis", "valid"):
        theirs = ["" if v is None else v for v in table[name].to_pylist()]
        ours = [row[name] for row in rows]
        assert [v == "" for v in theirs] == [v == "" for v in ours]
        assert [v for v in theirs if v != ""] == pytest.approx([float(v) for v in ours if v], abs=1e-6)
    assert set(table["state"].to_pylist()) == {row["state"] for row in rows}


def trajectory(path: Path) -> np.ndarray:
    return np.loadtxt(path)


def test_tum_has_a_pose_a_line_in_rising_time(exported: Path) -> None:
    poses = trajectory(exported / "leader.tum")
    assert poses.shape[1] == 8
    assert (np.diff(poses[:, 0]) > 0).all()
    assert poses[:, 4:].tolist() == [[0, 0, 0, 1]] * len(poses)
    last = poses[-1]
    assert np.linalg.norm(last[1:4] - CIRCLE.relative(last[0])[0]) < 4.0


def test_evo_reads_it(exported: Path) -> None:
    evo = shutil.which("evo_ape", path=str(Path(sys.executable).parent)) or shutil.which("evo_ape")
    if evo is None:
        pytest.skip("needs evo (pip install evo), which is large")
    files = [str(exported / "leader-truth.tum"), str(exported / "leader.tum")]
    done = subprocess.run(
        [evo, "tum", *files, "--t_max_diff", "0.03"], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    (rmse,) = [float(line.split()[1]) for line in done.stdout.splitlines() if line.split()[:1] == ["rmse"]]
    assert 0.0 < rmse < 6.0


def test_own_poses_have_their_attitude(tmp_path: Path) -> None:
    dataflash(CIRCLE, 8.0, tmp_path / "flight.bin")
    own = [tmp_path / f"own.{kind}" for kind in ("tum", "csv")]
    outs = [word for path in own for word in ("--own", str(path))]
    assert main(["replay", str(tmp_path / "flight.bin"), "--set", "estimator.own_state={}", *outs]) == 0
    poses = trajectory(own[0])
    assert len(poses) > 100
    t, *_, qx, qy, qz, qw = poses[-1]
    roll = math.atan2(2 * (qw * qx + qy * qz), 1 - 2 * (qx * qx + qy * qy))
    assert roll == pytest.approx(CIRCLE.at(t).rpy[0], abs=0.03)
    assert (np.diff(poses[:, 0]) > 0).all()


def test_foxglove_reads_its_own_schemas(exported: Path) -> None:
    pytest.importorskip("mcap_protobuf", reason="needs the extra `foxglove`")
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415

    with (exported / "leader.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [
            (schema.name, channel.topic, message)
            for schema, channel, _, message in reader.iter_decoded_messages(
                topics=["/tf", "/own/pose", "/leader/pose", "/scene", "/log"]
            )
        ]
        ours = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["estimate/leader"])]
    assert len(ours) > 250
    poses = [m.timestamp.ToNanoseconds() for _, topic, m in decoded if topic == "/leader/pose"]
    assert poses == [record["t_ns"] for record in ours if record["valid"]]  # all of them
    names = {topic: name for name, topic, _ in decoded}
    assert names == {
        "/tf": "foxglove.FrameTransform",
        "/own/pose": "foxglove.PoseInFrame",
        "/leader/pose": "foxglove.PoseInFrame",
        "/scene": "foxglove.SceneUpdate",
        "/log": "foxglove.Log",
    }
    own = [m for _, topic, m in decoded if topic == "/own/pose"][-1]
    t = own.timestamp.ToNanoseconds() * 1e-9
    north, east, down = CIRCLE.at(t).r
    p = own.pose.position
    assert (p.x, p.y, p.z) == pytest.approx((east, north, -down), abs=0.3)
    leader = [m for _, topic, m in decoded if topic == "/leader/pose"][-1]
    r_n, _ = CIRCLE.relative(leader.timestamp.ToNanoseconds() * 1e-9)
    at = CIRCLE.at(leader.timestamp.ToNanoseconds() * 1e-9).r + r_n
    p = leader.pose.position
    assert (p.x, p.y, p.z) == pytest.approx((at[1], at[0], -at[2]), abs=4.0)
    scenes = [m for _, topic, m in decoded if topic == "/scene"]
    (sphere,) = [s for m in scenes for e in m.entities for s in e.spheres][-1:]
    assert min(sphere.size.x, sphere.size.y, sphere.size.z) > 0
    assert any("tracking" in m.message for _, topic, m in decoded if topic == "/log")


def test_ros_reads_a_bag(exported: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel", reason="needs the extra `ros2`")
    with highlevel.AnyReader([exported / "leader.ros2"]) as bag:
        read = [(c.topic, c.msgtype, t, bag.deserialize(data, c.msgtype)) for c, t, data in bag.messages()]
    kinds = {topic: kind for topic, kind, *_ in read}
    assert kinds == {
        "/tf": "tf2_msgs/msg/TFMessage",
        "/onboard/detections": "vision_msgs/msg/Detection3DArray",
        "/onboard/leader/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
        "/onboard/leader/odometry": "nav_msgs/msg/Odometry",
        "/onboard/markers": "visualization_msgs/msg/MarkerArray",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    }
    times = [t for _, _, t, _ in read]
    assert times == sorted(times)
    _, _, t, pose = [one for one in read if one[0] == "/onboard/leader/pose"][-1]
    (north, east, down), _ = CIRCLE.relative(t * 1e-9)
    p = pose.pose.pose.position
    assert (p.x, p.y, p.z) == pytest.approx((east, north, -down), abs=4.0)
    transforms = {
        one.child_frame_id: one.transform for topic, *_, m in read if topic == "/tf" for one in m.transforms
    }
    at = [m for topic, *_, m in read if topic == "/tf" and len(m.transforms) == 2][-1].transforms[0].header.stamp
    north, east, down = CIRCLE.at(at.sec + at.nanosec * 1e-9).r
    p = transforms["base_enu"].translation
    assert (p.x, p.y, p.z) == pytest.approx((east, north, -down), abs=0.3)
    seconds = [m for topic, *_, m in read if topic == "/diagnostics"]
    assert len(seconds) == 9
    assert {s.name for s in seconds[-1].status} == {"onboard", "onboard: leader"}


def test_a_bag_is_never_overwritten(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags", reason="needs the extra `ros2`")
    out = exported / "leader.ros2"
    assert main(["replay", str(exported / "flight.mcap"), *SIZE, "--out", str(out)]) == 2
    assert f"cannot write {out}: it exists, and a bag is a folder of its own" in capsys.readouterr().err


def test_a_suffix_that_says_no_format_is_refused() -> None:
    with pytest.raises(UserError, match=r"one of \.csv, \.parquet, \.tum, \.mcap, \.ros2"):
        check_exports(Path("estimates.txt"))


def test_attitudes_have_nine_decimals_other_numbers_six_or_fewer() -> None:
    file = io.StringIO()
    CsvWriter(file, OWN_TABLE).write(nav_state(1000, q_nb=(0.5, 0.5, 0.5, 0.5)))
    names, values = (line.split(",") for line in file.getvalue().splitlines())
    row = dict(zip(names, values, strict=True))
    decimals = {name: len(row[name].partition(".")[2]) for name in ("time_boot_s", "q_w", "q_z", "quality")}
    assert decimals == {"time_boot_s": 6, "q_w": 9, "q_z": 9, "quality": 0}
