import csv
import gzip
import hashlib
import socket
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import Datagram, Encoding, TargetPoints
from onboard.wire.documents.points import decode_points
from onboard.wire.logs.tlog import read_tlog
from onboard.wire.mavlink.decode import MavlinkDecoder
from simlink.cli import main
from simlink.scenarios.scenario import (
    Scenario,
    ScenarioError,
    load_scenario,
    parse_scenario,
    rotate_slot,
    scenario_names,
)
from simlink.simulation import datagrams
from studies.relative_motion.flight import fly
from tests.support.images import detections


def test_formation_toml_writes_every_default_out() -> None:
    written = load_scenario("formation")
    assert written == Scenario(description=written.description, own_errors=True, spread=1.6)


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_loads_and_has_a_description(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sped = 1", "unknown key 'sped' in the top level; known: name, description, duration"),
        ("[leader]\nspeeed = 1", "unknown key 'speeed' in [leader]; known: size, size_sigma_percent, speed,"),
        (
            "[[camera.blackouts]]\nstart = 1\nend = 2\n[[camera.blackouts]]\nbegin = 3",
            "unknown key 'begin' in [camera.blackouts[1]]; known: start, end",
        ),
        ("[leader]\nspeed = nan", "leader.speed must be finite"),
        ("[follower]\nslot = [1.0, 2.0, inf]", "follower.slot[2] must be finite"),
        ("[leader]\nspeed = -1", ">= 0.0 - at `leader.speed`"),
        ("[leader]\nspeed = 'fast'", "Expected `float`, got `str` - at `leader.speed`"),
        ("[vehicle]\ntype = 'boat'", "'boat' - at `vehicle.type`"),
        ("[camera]\nblackouts = [{ start = 5.0, end = 4.0 }]", "camera.blackouts: needs start < end"),
        ("[leader]\nspeed = 4.0\nspeed_pulses = [{ start = 1.0, end = 2.0, change = -4.0 }]", "at least 1 m/s"),
        (
            "[camera]\nstamp_late = 0.03",
            "camera.stamp_late is 0.03 s; at most camera.latency (0.02 s)",
        ),
        ("[camera]\nwrong_blob = 0.1\nsees = 'box'", "camera.wrong_blob needs camera.sees = 'wing', not 'box'"),
        ("[leader", "end of document"),
        ("extends = 'quadrotr'", "extends: no scenario 'quadrotr'; known: formation"),
    ],
)
def test_an_invalid_scenario_names_the_key(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=r"^mine\.toml: ") as caught:
        parse_scenario(text, "mine", "mine.toml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_scenario_extends_another() -> None:
    base = load_scenario("quadrotor")
    text = "extends = 'quadrotor'\n[gps]\ndelay = 0.2\n[gps.position]\nsigma = 3.0"
    position = replace(base.gps.position, sigma=3.0)
    expected = replace(base, name="mine", gps=replace(base.gps, delay=0.2, position=position))
    assert parse_scenario(text, "mine") == expected
    assert load_scenario("quadrotor-gps-loss").nav == base.nav


def test_the_slot_seen_from_the_side_is_the_reference_slot_turned() -> None:
    turned, file = rotate_slot(load_scenario("formation"), 45.0), load_scenario("formation-from-the-side")
    # (-90, 10) ft turned by 45 degrees: (-100, -80) ft / sqrt 2
    assert turned.follower.slot == pytest.approx((-100 * 0.3048 / 2**0.5, -80 * 0.3048 / 2**0.5, 1.524))
    assert turned.camera.mount_rpy_deg == file.camera.mount_rpy_deg == (0.0, 0.0, 45.0)
    assert file.follower.slot == pytest.approx(turned.follower.slot, abs=1e-4)
    flight = fly(file, 1, 60.0)
    seen = flight.image_points[~np.isnan(flight.image_points[:, 0, 0])]
    assert len(seen) > 0.85 * len(flight.image_t)
    # in the turn the follower's course is 6 degrees left of the leader's: some 39 degrees are left of the 45
    span = np.linalg.norm(seen[:, 2] - seen[:, 1], axis=1)
    assert np.median(span) * 27.64 == pytest.approx(flight.size * 0.82, rel=0.07)


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def log(folder: Path, seed: int, tag: str) -> tuple[Path, Path]:
    out, truth = folder / f"{tag}.tlog", folder / f"{tag}.csv.gz"
    arguments = ["log", "formation", "--seed", str(seed), "--duration", "4"]
    assert main([*arguments, "--out", str(out), "--truth", str(truth)]) == 0
    return out, truth


def test_the_same_seed_gives_the_same_bytes_seeds_5_and_6(tmp_path: Path) -> None:
    first, again, other = log(tmp_path, 5, "a"), log(tmp_path, 5, "b"), log(tmp_path, 6, "c")
    assert [digest(p) for p in first] == [digest(p) for p in again]
    assert [digest(p) for p in first] != [digest(p) for p in other]
    assert first[1].read_bytes()[4:8] == bytes(4)  # gzip's time stamp


def test_a_recording_holds_what_was_flown_seed_5(tmp_path: Path) -> None:
    out, truth = log(tmp_path, 5, "a")
    decoder, images, times = MavlinkDecoder(stream=False), [], []
    for record, _ in read_tlog(out.read_bytes()):
        assert record is not None
        times.append(record.t_recv_ns)
        images += [
            m for m in detections(decoder.decode(record.data, record.t_recv_ns)) if isinstance(m, TargetPoints)
        ]
    assert times == sorted(times)
    assert not decoder.rejected
    assert decoder.names["LOCAL_POSITION_NED"] == 201
    assert decoder.names["LANDING_TARGET"] == 3 * len(images)
    rows = list(csv.DictReader(gzip.decompress(truth.read_bytes()).decode().splitlines()))
    assert len(rows) == 101
    row = {float(r["time_boot_s"]): r for r in rows}[images[-1].t_ns * 1e-9]
    # straight ahead or nearly: distance times the angle between the wing points is the size
    distance = sum(float(row[f"r_{axis}_m"]) ** 2 for axis in ("north", "east", "down")) ** 0.5
    span = images[-1].right[0] - images[-1].left[0]
    assert span * distance == pytest.approx(float(row["size_m"]), rel=0.1)
    assert images[-1].component == 191
    assert list(rows[0])[7:10] == ["size_m", "a_lat_m_s2", "a_long_m_s2"]


def test_both_camera_links_carry_the_same_points_seed_3() -> None:
    def points(camera: str) -> list[TargetPoints]:
        decoder, found = MavlinkDecoder(stream=False), []
        for item in datagrams(load_scenario("formation"), 3, 2.0, camera):
            if isinstance(item, Datagram) and item.encoding is Encoding.POINTS:
                found += decode_points(item.data, item.t_recv_ns).detections
            elif isinstance(item, Datagram) and item.channel == "camera":
                found += [
                    m for m in detections(decoder.decode(item.data, item.t_recv_ns)) if isinstance(m, TargetPoints)
                ]
        return found

    by_zenoh, by_mavlink = points("zenoh"), points("mavlink")
    assert len(by_zenoh) == len(by_mavlink) > 40
    for a, b in zip(by_zenoh, by_mavlink, strict=True):
        assert a.t_ns == b.t_ns
        assert a.left == pytest.approx(b.left, abs=1e-6)
        assert a.right == pytest.approx(b.right, abs=1e-6)
    assert points("none") == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "nowhere"], "no scenario 'nowhere'; known: formation"),
        (["run", "formation", "--speed", "0"], "--speed: must be above zero"),
        (["run", "formation", "--speed", "quick"], "--speed: must be a number"),
        (["run", "formation", "--duration", "nan"], "--duration: must be a number"),
        (["run", "formation", "--seed", "-3"], "--seed: must be a whole number"),
        (["run", "formation", "--tcp", "70000"], "--tcp: must be 0"),
        (["run", "formation", "--mavlink", "14540"], "bad link '14540': expected udpout:HOST:PORT"),
        (["run", "formation", "--mavlink", "udpout:127.0.0.1:x"], "bad link 'udpout:127.0.0.1:x'"),
        (["run", "formation", "--zenoh", "none"], "choose --camera mavlink or none"),
        (["run", "formation", "--vehicle", "a*"], "bad vehicle id 'a*'"),
        (["run", "missing.toml"], "missing.toml: No such file"),
        (["fly", "formation"], "invalid choice: 'fly'"),
        (["log", "formation"], "required: --out"),
    ],
)
def test_a_usage_error_is_one_line_and_exit_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(arguments)
    except SystemExit as exit_:
        code = exit_.code
    captured = capsys.readouterr()
    assert code == 2
    assert message in captured.err
    assert captured.err.count("\n") == 1


def test_a_port_in_use_is_one_line_and_exit_2(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        arguments = ["--camera", "none", "--zenoh", "none", "--mavlink", "none", "--tcp", str(port)]
        assert main(["run", "formation", *arguments]) == 2
    line = capsys.readouterr().err
    assert f"cannot listen on TCP 127.0.0.1:{port}" in line
    assert "address already in use" in line
    assert line.count("\n") == 1


def test_a_file_that_cannot_be_written_is_one_line_and_exit_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "no" / "such.tlog"
    assert main(["log", "formation", "--out", str(out), "--duration", "1"]) == 1
    assert capsys.readouterr().err == f"simlink: cannot write {out}: No such file or directory\n"
