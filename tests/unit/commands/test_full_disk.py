"""A disk that is full while a command writes: one line says so, and no traceback."""

from pathlib import Path

import pytest

from onboard.commands.cli import main
from simlink import cli as simlink

FULL = Path("/dev/full")

pytestmark = pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full, which Linux has")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("full") / "flight.tlog"
    assert simlink.main(["log", "formation-s-turn", "--seed", "1", "--duration", "8", "--out", str(path)]) == 0
    return path


@pytest.mark.parametrize(
    "call",
    [
        ["replay", "LOG", "--out", str(FULL)],
        ["replay", "LOG", "--own", str(FULL), "--set", "estimator.own_state={}"],
        ["replay", "LOG", "--rrd", str(FULL)],
        ["replay", "LOG", "--json", str(FULL)],
        ["calibrate", "LOG", "--svg", str(FULL)],
    ],
    ids=lambda call: call[2],
)
def test_a_full_disk_is_one_line_seed_1(call: list[str], log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(log) if word == "LOG" else word for word in call]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last.startswith("onboard: ")
    assert "No space left on device" in last


def test_a_recording_of_the_view_that_ends_early_is_one_line(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rerun import RecordingStream  # noqa: PLC0415 - an extra

    def flush(*_: object, **__: object) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")  # as Rerun does, once the disk is full

    monkeypatch.setattr(RecordingStream, "flush", flush)
    path = tmp_path / "view.rrd"
    assert main(["replay", str(log), "--rrd", str(path)]) == 2
    assert f"onboard: the view cannot be written to {path}: File-writer" in capsys.readouterr().err


def test_simlink_says_so_too_seed_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert simlink.main(["log", "formation", "--seed", "1", "--duration", "2", "--out", str(FULL)]) == 1
    assert capsys.readouterr().err == "simlink: cannot write its files: No space left on device\n"
