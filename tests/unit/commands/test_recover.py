"""`onboard recover`: a recording of a killed program, as other programs' readers want it."""

from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from onboard.commands import cli
from onboard.messages import Datagram, Encoding
from onboard.sinks.recorder import Recorder
from onboard.wire.logs.recording import read_recording
from tests.support.records import make_estimate, read_estimates

COUNT = 50


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """A recording without an end, as SIGKILL leaves it."""
    recorder = Recorder(tmp_path / "flight.mcap", monotonic=iter(range(10**6)).__next__)
    recorder.open()
    for n in range(COUNT):
        data = n.to_bytes(4, "big")
        recorder.write(
            [
                Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=10**18 + n, data=data),
                make_estimate(n),
            ]
        )
    killed = tmp_path / "killed.mcap"
    killed.write_bytes(recorder.path.read_bytes())
    recorder.close()
    return killed


def ordinary(path: Path) -> list[tuple[str, int, bytes]]:
    """What mcap's own reader finds."""
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def recovered(path: Path, *more: str) -> Any:
    assert cli.main(["recover", str(path), *more]) == 0
    return path.with_name("killed-recovered.mcap")


def test_an_ordinary_reader_reads_what_was_recovered(killed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(McapError):
        ordinary(killed)
    before = killed.read_bytes()
    path = recovered(killed)
    assert capsys.readouterr().out.splitlines() == [
        f"{path}: {2 * COUNT} records; 1 stretch could not be read",
        f"{killed} has no end: what wrote it was killed. `onboard` reads it; others want {path.name}",
    ]
    assert len(ordinary(path)) == 2 * COUNT
    assert [d for d, _ in read_recording(path)] == [d for d, _ in read_recording(killed) if d is not None]
    assert list(read_estimates(path)) == [make_estimate(n) for n in range(COUNT)]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert [s.name for s in summary.schemas.values()] == ["Estimate"]
    assert killed.read_bytes() == before


def test_damage_in_the_middle_is_said_and_the_rest_is_kept(
    killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(killed.read_bytes())
    data[len(data) // 2] ^= 0xFF
    killed.write_bytes(data)
    path = recovered(killed)
    assert 2 * COUNT - 4 <= len(ordinary(path)) < 2 * COUNT
    assert "2 stretches could not be read" in capsys.readouterr().out


def test_nothing_is_overwritten_and_the_file_can_be_named(
    killed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = recovered(killed)
    before = first.read_bytes()
    assert cli.main(["recover", str(killed)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert first.read_bytes() == before
    recovered(killed, "--out", str(tmp_path / "named.mcap"))
    assert ordinary(tmp_path / "named.mcap") == ordinary(first)


@pytest.mark.parametrize("content", [b"", b"no recording at all"])
def test_what_is_no_recording_is_one_line(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(content)
    assert cli.main(["recover", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["flight.tlog"]


def test_the_wall_clock_of_each_arrival_is_recovered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Channels' metadata say that the publish time is the wall clock's, which is set during the flight."""
    recorder = Recorder(tmp_path / "flight.mcap", monotonic=iter(range(10**6)).__next__)
    recorder.open()
    sent = [
        Datagram(
            channel="a",
            encoding=Encoding.DETECTIONS,
            t_recv_ns=10**18 + n,
            data=bytes([n]),
            wall_step_ns=0 if n < 5 else 3_600_000_000_000,
        )
        for n in range(10)
    ]
    recorder.write(sent)
    recorder.close()
    assert cli.main(["recover", str(recorder.path)]) == 0
    path = recorder.path.with_name(f"{recorder.path.stem}-recovered.mcap")
    assert capsys.readouterr().out == f"{path}: 10 records; 0 stretches could not be read\n"
    assert [d for d, _ in read_recording(path) if d is not None] == sent
