"""Which files a recorder leaves: none that is empty, none beside a folder, none that everybody can read."""

import errno
import os
import re
from collections.abc import Callable
from contextlib import suppress
from itertools import repeat
from pathlib import Path

import pytest
from mcap.reader import make_reader

from onboard.messages import Datagram, Encoding
from onboard.sinks import SinkError
from onboard.sinks.recorder import Recorder, Rotation
from onboard.wire.logs.recording import read_recording
from tests.support.records import record
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


DAY = 86_400.0
NOW = 1_795_000_000.0  # of tests, November 2026
LATER = NOW + 200 * DAY


def recorded(path: Path, rotation: Rotation, *stamps: float, report: Callable[[str], None] = print) -> None:
    """Fill a file for each time that its computer's clock shows."""
    for stamp in stamps:
        now_ns = repeat(round(stamp * 1e9)).__next__
        options = {"rotation": rotation, "report": report, "monotonic": lambda: 0.0, "now_ns": now_ns}
        os.utime(record(path, [datagram(0)], **options), (stamp, stamp))


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
    others = [tmp_path / f"{name}.mcap" for name in ("flight-a", "flight2", "other", "flight-1", "flight-0042")]
    for other in others:
        other.write_text("mine")
        os.utime(other, (NOW, NOW))
    said: list[str] = []
    recorded(tmp_path / "flight.mcap", Rotation(), NOW, NOW, NOW)
    recorded(tmp_path / "flight.mcap", rotation, LATER, report=said.append)
    assert {p.name for p in tmp_path.iterdir()} == {*(f"flight{k}.mcap" for k in left), *(p.name for p in others)}
    removed = [line for line in said if re.search(r"removed .*flight.*\.mcap, .*: .*keep_(mb|days) is", line)]
    assert len(removed) == len(said) == 4 - len(left)


@pytest.mark.parametrize(
    ("stamps", "now", "left"),
    [
        # the numbers of those that are left, of recordings made at these times and one more, with keep_days 30
        ((400.0, 1200.0), LATER, {1, 2, 3}),  # without a clock: who knows
        ((400.0, NOW, 400.0), LATER, {3, 4}),  # the first is at least as old as the second
        ((NOW, LATER - DAY, NOW + DAY), LATER, {2, 3, 4}),  # stamped as it was last switched off
        ((NOW, NOW + DAY), 1200.0, {1, 2, 3}),  # the field is without a clock
        ((NOW, NOW + DAY), NOW + 1024 * 7 * DAY, {1, 2, 3}),  # a GPS that is 1,024 weeks off
        ((LATER + DAY, NOW, LATER - DAY), LATER, {3, 4}),  # the first clock was ahead
        ((NOW, NOW + DAY), NOW + 370 * DAY, {1, 2, 3}),  # a clock that has leapt by a year ...
        ((NOW, NOW + DAY, NOW + 370 * DAY), NOW + 371 * DAY, {1, 2, 3, 4}),  # ... at the second start, too
        ((NOW, NOW + 370 * DAY, NOW + 371 * DAY), NOW + 410 * DAY, {4}),  # what is old by either clock goes
    ],
)
def test_a_recording_is_not_old_because_its_clock_was_not_set(
    stamps: tuple[float, ...], now: float, left: set[int], tmp_path: Path
) -> None:
    recorded(tmp_path / "flight.mcap", Rotation(), *stamps)
    recorded(tmp_path / "flight.mcap", Rotation(keep_days=30.0), now)
    names = {"flight.mcap" if n == 1 else f"flight-{n}.mcap" for n in left}
    assert {p.name for p in tmp_path.iterdir()} == names


def test_recordings_without_a_label_make_room_by_their_stamps_and_copies_never(tmp_path: Path) -> None:
    """Versions that wrote no label gave a number again once it was free: 3 and 4 are older than 1 and 2. What a
    pilot has copied keeps the label of the original."""
    stamps = {"": 400.0, "-2": 1200.0, "-3": NOW, "-4": NOW + DAY, "-20260101": NOW}
    for number, stamp in stamps.items():
        (tmp_path / f"flight{number}.mcap").write_bytes(bytes(1000))
        os.utime(tmp_path / f"flight{number}.mcap", (stamp, stamp))
    recorded(tmp_path / "flight.mcap", Rotation(keep_bytes=2500.0), LATER)
    (tmp_path / "flight-5.mcap").rename(tmp_path / "flight-42.mcap")
    recorded(tmp_path / "flight.mcap", Rotation(keep_bytes=1.0), LATER + DAY)
    assert {p.name for p in tmp_path.iterdir()} == {f"flight-{n}.mcap" for n in (20260101, 42, 3)}


def test_a_path_that_is_a_folder_is_an_error_before_the_flight(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    with pytest.raises(SinkError, match=r"is a folder.*recordings/flight\.mcap"):
        Recorder(folder).check()
    assert [p.name for p in tmp_path.iterdir()] == ["recordings"]


def test_the_first_record_is_logged_at_its_own_time(tmp_path: Path) -> None:
    """A health comes once a second, whether anything was received or not."""
    first = health_of(10**18 - 5)
    with record(tmp_path / "flight.mcap", [first, datagram(0)]).open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert times == sorted([first.t_recv_ns, 10**18])
