"""Which files a recorder leaves: none that is empty, none beside a folder, none that everybody can read."""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.reader import make_reader

from onboard.messages import Datagram, Encoding
from onboard.sinks import SinkError
from onboard.sinks.recorder import Recorder, Rotation
from onboard.wire.recording import read_recording
from tests.support.view_flight import health_of


def datagram(n: int) -> Datagram:
    return Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=10**18 + n, data=b"x" * 100)


def no_space(_: int) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_no_empty_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fdatasync", no_space)
    recorder = Recorder(tmp_path / "flight.mcap")
    for _ in range(5):  # as the runner retries
        with pytest.raises(SinkError, match="No space left"):
            recorder.open()
        recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_later_keeps_what_was_written_and_leaves_no_empty_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path / "flight.mcap", monotonic=iter(range(100)).__next__)
    recorder.open()
    recorder.write([datagram(0)])  # and flush
    monkeypatch.setattr(os, "fdatasync", no_space)
    with pytest.raises(OSError, match="No space left"):
        recorder.write([datagram(1)])
    with suppress(OSError):
        recorder.close()
    for _ in range(5):
        with pytest.raises(SinkError, match="No space left"):
            recorder.open()
        recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap"]
    assert next(read_recording(tmp_path / "flight.mcap"))[0] == datagram(0)


def recorded(path: Path, rotation: Rotation, files: int) -> None:
    """Fill as many files, each a second apart."""
    recorder = Recorder(path, rotation=rotation, monotonic=iter(range(100)).__next__)
    for n in range(files):
        recorder.open()
        recorder.write([datagram(n)])
        recorder.close()
        os.utime(recorder.path, (10**9 + n, 10**9 + n))


def test_a_file_that_is_large_enough_is_followed_by_another(tmp_path: Path) -> None:
    recorder = Recorder(
        tmp_path / "flight.mcap", rotation=Rotation(file_bytes=1.0), monotonic=iter(range(100)).__next__
    )
    recorder.open()
    for n in range(3):
        recorder.write([datagram(n)])
    recorder.close()
    found = [[d for d, _ in read_recording(tmp_path / f"flight{k}.mcap") if d] for k in ("", "-2", "-3", "-4")]
    assert found == [[datagram(0)], [datagram(1)], [datagram(2)], []]


@pytest.mark.parametrize(
    ("rotation", "left"),
    [
        (Rotation(), ["", "-2", "-3", "-4"]),
        (Rotation(keep_bytes=1.0), ["-4"]),
        (Rotation(keep_bytes=1e6), ["", "-2", "-3", "-4"]),
        (Rotation(keep_days=1.0), ["-4"]),
    ],
)
def test_the_oldest_recordings_of_a_name_are_removed(rotation: Rotation, left: list[str], tmp_path: Path) -> None:
    """Each start left one more, until the disk was full."""
    others = [tmp_path / name for name in ("flight-a.mcap", "flight2.mcap", "flight.csv", "other.mcap")]
    for other in others:
        other.write_text("mine")
        os.utime(other, (1, 1))
    recorded(tmp_path / "flight.mcap", Rotation(), 3)
    recorded(tmp_path / "flight.mcap", rotation, 1)
    assert {p.name for p in tmp_path.iterdir()} == {*(f"flight{k}.mcap" for k in left), *(p.name for p in others)}


def test_a_recording_that_received_nothing_is_kept_if_it_was_ended_in_order(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "flight.mcap")
    recorder.open()
    recorder.close()
    assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap"]


def test_a_path_that_is_a_folder_is_an_error_before_the_flight(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    with pytest.raises(SinkError, match=r"is a folder.*recordings/flight\.mcap"):
        Recorder(folder).check()
    assert [p.name for p in tmp_path.iterdir()] == ["recordings"]


def test_recordings_are_not_readable_by_everybody(tmp_path: Path) -> None:
    mask = os.umask(0)
    try:
        recorder = Recorder(tmp_path / "new" / "flight.mcap")
        recorder.open()
        recorder.close()
    finally:
        os.umask(mask)
    assert stat.S_IMODE(recorder.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(recorder.path.parent.stat().st_mode) == 0o700


def test_the_first_record_is_logged_at_its_own_time(tmp_path: Path) -> None:
    """A health comes once a second, whether anything was received or not."""
    recorder = Recorder(tmp_path / "flight.mcap")
    recorder.open()
    first = health_of(10**18 - 5)
    recorder.write([first, datagram(0)])
    recorder.close()
    with recorder.path.open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert times == sorted([first.t_recv_ns, 10**18])
