"""Mistakes on the command line: each is one line that says what is wrong, and exit code 2."""

import gzip
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from onboard import with_extra
from onboard.commands import cli
from simlink import cli as simlink_cli
from tests.support.programs import ROOT, argv, environment, run
from tests.support.streams import TRUTH_COLUMNS

HEADER = f"{TRUTH_COLUMNS}\n"
ROW = "{},30,0,0,0,0,0,2.0\n"


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of two seconds, seed 1, as a .tlog."""
    path = tmp_path_factory.mktemp("flight") / "flight.tlog"
    assert simlink_cli.main(["log", "formation", "--seed", "1", "--duration", "2", "--out", str(path)]) == 0
    return path


@pytest.fixture
def files(tmp_path: Path, flight: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder, the current one, with all kinds of files."""
    log = flight.read_bytes()
    contents: dict[str, bytes] = {
        "flight.tlog": log,
        "flight.tlog.gz": gzip.compress(log),
        "empty.tlog": b"",
        "photo.jpg": b"\xff\xd8\xff\xe0\x00\x10JFIF" + bytes(range(256)) * 4,
        "words.txt": b"these are words, and no flight\n" * 20,
        "stub.ulg": b"ULog\x01\x12\x35\x01" + bytes(8),
        "damaged.mcap": b"\x89MCAP0\r\n" + b"\xff" * 100,
        "words.toml": b"these are words\n",
        "unknown.toml": b"[camera]\nfocal_length = 3\n",
        "wrong-type.toml": b'[camera]\nf_px = "wide"\n',
        "words.csv": b"these are words\n",
        "columns.csv": b"time_boot_s,range_m\n1,2\n2,3\n",
        "no-position.csv": b"time_boot_s,size_m\n1,2\n2,3\n",
        "header.csv": HEADER.encode(),
        "unsorted.csv": (HEADER + ROW.format(2) + ROW.format(1)).encode(),
        "letters.csv": (HEADER + ROW.format("soon")).encode(),
        "short.csv": (HEADER + "1,2\n").encode(),
        "not-a-number.csv": (HEADER + ROW.format(1).replace("30", "nan")).encode(),
        "plain.csv.gz": HEADER.encode(),
        "cut.csv.gz": gzip.compress((HEADER + ROW.format(1)).encode())[:-9],
        "good.csv": (HEADER + "".join(ROW.format(t) for t in range(40, 44))).encode(),
    }
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))  # the demo starts the simulator, from here
    return tmp_path


REPLAY = ("replay", "flight.tlog")
MISTAKES: list[tuple[tuple[str, ...], tuple[str, ...]]] = [
    # the call itself
    ((), ("COMMAND",)),
    (("fly",), ("'fly'", "replay", "demo")),
    (("replay",), ("log",)),
    (("run", "--no-such-flag"), ("--no-such-flag",)),
    (("demo", "--duration", "-5"), ("--duration", "'-5'")),
    (("demo", "--duration", "nan"), ("--duration", "positive")),
    (("demo", "--duration", "soon"), ("--duration", "'soon'")),
    (("demo", "--seed", "-1"), ("--seed", "'-1'")),
    (("demo", "--seed", "1.5"), ("--seed", "'1.5'")),
    (("demo", "--headless", "--scenario", "no-such"), ("'no-such'", "formation-s-turn")),
    (("demo", "--headless", "--set", "camera.f=1"), ("camera.f", "f_px")),
    (("demo", "--headless", "--out", "words.txt/out"), ("words.txt/out", "folder")),
    (("demo", "--headless", "--json", "nowhere/score.json"), ("nowhere/score.json",)),
    (("study", "no-such"), ("'no-such'", "relative-motion")),
    (("study",), ("--all", "relative-motion")),
    (("study", "relative-motion", "--all"), ("--all",)),
    (("study", "relative-motion", "--seeds", "0"), ("--seeds", "from 1 to")),
    (("study", "relative-motion", "--jobs", "0"), ("--jobs", "from 1 to")),
    (("study", "--all", "--first-seed", "7"), ("--first-seed", "goes with one name")),
    (("study", "relative-motion", "--seeds", "99999999999"), ("--seeds", "1000000")),
    (("study", "relative-motion", "--seeds", "1", "--out", "words.txt/out"), ("words.txt/out",)),
    (("study", "relative-motion", "--seeds", "1", "--json", "nowhere/x.json"), ("nowhere/x.json",)),
    (("view", "no-such.rrd"), ("no-such.rrd",)),
    (("view", "photo.jpg", "--png", "x.png"), ("photo.jpg", ".rrd")),
    # configuration
    (("run", "no-such.toml"), ("no-such.toml", "No such file")),
    (("run", "words.toml"), ("words.toml", "not TOML", "line 1")),
    (("run", "photo.jpg"), ("photo.jpg", "not TOML")),
    (("run", "folder"), ("folder", "directory")),
    (("run", "unknown.toml"), ("camera.focal_length", "f_px", "mount_rpy_deg")),
    (("run", "wrong-type.toml"), ("camera.f_px", "float")),
    (("run", "--set", "camera.f_px"), ("KEY=VALUE",)),
    (("run", "--set", "=3"), ("KEY=VALUE",)),
    (("run", "--set", "no_such_key=3"), ("no_such_key", "camera", "zenoh")),
    (("run", "--set", "estimator.leadr.filter=paper"), ("estimator.leadr", "leader")),
    (("run", "--set", "estimator.traffic.filter=loud"), ("estimator.traffic.filter", "loud")),
    (("run", "--set", "zenoh.vehicle=a/b"), ("a/b",)),
    (("run", "--set", "link=[{name='a', url='udp:1'}]"), ("'udp:1'", "udpin:HOST:PORT")),
    (("run", "--set", "link=[{name='a', url='udpin:127.0.0.1:x'}]"), ("'x'", "port")),
    (("run", "--set", "link=[{name='a', url='serial:/dev/ttyUSB0'}]"), ("serial:DEVICE:BAUD",)),
    (
        ("run", "--set", "zenoh.enabled=false", "--set", "link=[{name='a', url='serial:/dev/null:57600'}]"),
        ("/dev/null",),
    ),
    (("run", "--set", "zenoh.enabled=false", "--set", "recorder.path='words.txt/f.mcap'"), ("words.txt/f.mcap",)),
    # logs
    (("replay", "no-such.tlog"), ("no-such.tlog", "No such file")),
    (("replay", "folder"), ("folder", "expected one log", "none")),
    (("replay", "empty.tlog"), ("empty.tlog is empty",)),
    (("replay", "photo.jpg"), ("photo.jpg", "no .tlog")),
    (("replay", "words.txt"), ("words.txt", "no .tlog")),
    (("replay", "flight.tlog.gz"), ("flight.tlog.gz", "no .tlog")),
    (("replay", "stub.ulg"), ("stub.ulg", "ULog")),
    (("replay", "damaged.mcap"), ("damaged.mcap", "no record")),
    ((*REPLAY, "--config", "unknown.toml"), ("camera.focal_length",)),
    ((*REPLAY, "--set", "x"), ("KEY=VALUE",)),
    # truths
    ((*REPLAY, "--truth", "no-such.csv"), ("no-such.csv",)),
    ((*REPLAY, "--truth", "photo.jpg"), ("photo.jpg", "truth")),
    ((*REPLAY, "--truth", "folder"), ("folder",)),
    ((*REPLAY, "--truth", "plain.csv.gz"), ("plain.csv.gz", "gzip")),
    *(
        ((*REPLAY, "--truth", name), (name, "no truth table"))
        for name in (
            *("words.csv", "columns.csv", "no-position.csv", "header.csv", "unsorted.csv", "letters.csv"),
            *("short.csv", "not-a-number.csv", "cut.csv.gz", "empty.tlog"),
        )
    ),
    # outputs
    ((*REPLAY, "--out", "nowhere/rows.csv"), ("nowhere/rows.csv", "does not exist")),
    ((*REPLAY, "--json", "nowhere/score.json"), ("nowhere/score.json", "does not exist")),
    ((*REPLAY, "--rrd", "nowhere/view.rrd"), ("nowhere/view.rrd", "does not exist")),
    ((*REPLAY, "--out", "folder"), ("folder",)),
    ((*REPLAY, "--out", "flight.tlog"), ("flight.tlog", "the suffix")),
    ((*REPLAY, "--truth", "good.csv", "--json", "folder/../good.csv"), ("good.csv", "also an input")),
]


def called(main: Callable[[list[str]], int], arguments: tuple[str, ...]) -> int:
    try:
        return main(list(arguments))
    except SystemExit as end:  # argparse
        return int(str(end.code))


@pytest.mark.parametrize(("arguments", "words"), MISTAKES, ids=lambda x: " ".join(x)[:80])
@pytest.mark.usefixtures("files")
def test_mistake_is_one_line(
    arguments: tuple[str, ...], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(cli.main, arguments) == 2
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line != "stopped" and not line.startswith("link ")]
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("onboard")
    for word in words:
        assert word in lines[0]
    assert not captured.out


@pytest.mark.parametrize("arguments", [("run", "no-such.toml"), ("fly",), ("replay", "no-such.tlog")])
def test_mistake_seen_from_outside_is_one_line_and_no_traceback(arguments: tuple[str, ...]) -> None:
    done = run("onboard", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


def test_a_mistaken_log_leaves_what_would_be_overwritten_as_it_is(files: Path) -> None:
    rows = files / "rows.csv"
    rows.write_text("precious")
    for log in ("no-such.tlog", "photo.jpg", "empty.tlog", "damaged.mcap"):
        assert cli.main(["replay", log, "--out", "rows.csv"]) == 2
    assert rows.read_text() == "precious"


def test_a_truncated_tlog_is_replayed_and_said_to_be_damaged(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (files / "cut.tlog").write_bytes((files / "flight.tlog").read_bytes()[:-7])
    assert cli.main(["replay", "cut.tlog", "--json", "score.json"]) == 0
    assert "damaged" in capsys.readouterr().out
    assert json.loads((files / "score.json").read_bytes())["log"]["damaged"] == 1
    assert cli.main(["replay", "flight.tlog"]) == 0
    assert "damaged" not in capsys.readouterr().out


def test_several_keys_may_follow_one_set() -> None:
    assert cli._spread_sets(["replay", "--set", "a=1", "b=[2,3]", "LOG", "c=4", "--set", "d=5", "--out", "f"]) == (
        ["replay", "--set", "a=1", "--set", "b=[2,3]", "LOG", "c=4", "--set", "d=5", "--out", "f"]
    )
    assert cli._spread_sets(["run", "--set"]) == ["run", "--set"]
    assert cli._spread_sets(["run", "--set", "--out", "x=1"]) == ["run", "--set", "--out", "x=1"]


def test_a_replay_loads_no_zenoh_rerun_or_scipy(flight: Path) -> None:
    code = (
        "import sys; from onboard.commands import cli\n"
        f"assert cli.main(['replay', {str(flight)!r}]) == 0\n"
        "slow = {'zenoh', 'rerun', 'matplotlib', 'scipy.linalg', 'scipy.special'}\n"
        "sys.exit(','.join(slow & set(sys.modules)) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment(), check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("which", ["--all", "cwpa-kalman-tracker-3d"])
def test_a_study_without_matplotlib_is_one_line_before_anything_is_done(
    which: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(["study", which, "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == f"onboard: figures need matplotlib: {with_extra('study')}\n"
    assert not (tmp_path / "out").exists()


def test_output_into_a_pipe_that_closes_is_no_error() -> None:
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        done = subprocess.run(
            argv("onboard", "schema"),
            stdout=closed,
            stderr=subprocess.PIPE,
            env=environment(),
            check=False,
            timeout=300,
        )
    assert done.stderr == b""
    assert done.returncode == 0
