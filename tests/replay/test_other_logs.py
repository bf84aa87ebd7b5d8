"""Logs that we did not make: each is replayed to its end, with a summary, and the same every time."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.support.programs import DATA, run

LOGS = DATA / "logs"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not LOGS.is_dir(), reason="the recorded flights are not part of this repository (../shared/data)"
    ),
]
ULOGS = ("frrs_ekf_failure.ulg", "frrs_motor_failure.ulg", "pyulog_events.ulg", "pyulog_tagged.ulg")


def replayed(folder: Path, log: Path, *arguments: str) -> tuple[str, dict[str, Any]]:
    """(what is printed, the numbers)"""
    done = run("onboard", "replay", log, "--json", folder / "score.json", *arguments)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout, json.loads((folder / "score.json").read_bytes())


@pytest.mark.parametrize("name", ULOGS)
def test_ulog_gives_our_own_motion(tmp_path: Path, name: str) -> None:
    text, numbers = replayed(tmp_path, LOGS / name, "--out", str(tmp_path / "rows.csv"))
    assert "PX4" in text
    assert "no camera points" in text
    health = numbers["health"]
    on_the_bench = name == "pyulog_tagged.ulg"  # whose position estimate says that it is not valid
    for stream in ("Attitude", "Imu", "GpsFix", *(() if on_the_bench else ("LocalPosition",))):
        assert health["streams"][stream]["count"] > 100, stream
    assert numbers["log"]["duration_s"] > 5
    assert health["states"].get("leader", "searching") == "searching"
    rows = (tmp_path / "rows.csv").read_text().splitlines()
    assert rows[0].startswith("time_boot_s,state,r_north_m,")
    assert all(",0," in row for row in rows[1:])  # not valid: there is nothing to be valid


def test_tlog_of_a_ground_station_with_another_vehicles_hardware(tmp_path: Path) -> None:
    text, numbers = replayed(tmp_path, LOGS / "dronekit_flight.tlog")
    assert "ArduPilot" in text
    assert numbers["log"]["records"] > 10_000
    assert numbers["log"]["damaged"] == 1  # it ends in half a record
    assert numbers["health"]["streams"]["Attitude"]["count"] > 100
    assert numbers["diverged"] is False


def test_log_of_another_kind_is_refused_in_one_line() -> None:
    done = run("onboard", "replay", LOGS / "ecl_iris_gps.csv")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


def test_three_megabytes_of_the_formation_twice_give_the_same_csv_bit_for_bit(tmp_path: Path) -> None:
    log = tmp_path / "part.tlog"
    with (DATA / "formation-copter" / "follower.tlog").open("rb") as file:
        log.write_bytes(file.read(3_000_000))
    settings = ("--set", "camera.mount_rpy_deg=[0,15,0]", "--set", "estimator.leader.size_prior_m=2.0")
    tables = []
    for name in ("a.csv", "b.csv"):
        _, numbers = replayed(tmp_path, log, "--out", str(tmp_path / name), *settings)
        tables.append((tmp_path / name).read_bytes())
        assert numbers["valid"] > 1000
        assert numbers["log"]["damaged"] <= 1  # the cut at the end
    assert tables[0] == tables[1]
