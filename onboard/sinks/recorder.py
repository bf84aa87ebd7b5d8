"""The flight recorder: every datagram as received, and the estimates, in an MCAP file.

Flushed records are synced to the disk and survive a killed process and a power cut. Such a recording has no index,
but `onboard.wire.logs.recording` reads it. A recording is never overwritten: its number follows the highest of its
name. Its first metadata, RECORDING, hold that name and number, and the run, which may have several files.

The age of recordings follows these numbers, since a computer's clock may not be set: it then stamps 1970, or the
time of the last shutdown. A stamp counts if it follows those of all earlier recordings. A recording whose stamp
does not count is at least as old as the next one whose stamp does.
"""

import math
import os
import re
import secrets
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import msgspec
from mcap.exceptions import McapError
from mcap.records import Header, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from onboard.messages import Datagram, Estimate, Health, LeaderState, OwnPose, Record
from onboard.messages.schemas import key_of, schema
from onboard.sinks.sink import SinkError, SinkRunner
from onboard.units import S_PER_NS

Recorded = Datagram | Estimate | OwnPose | LeaderState | Health

# Metadata of a channel of datagrams: the meaning of its message numbers ...
WAIT_METADATA: Final[Mapping[str, str]] = {"sequence": "microseconds waited"}
# ... and, if its log time is from a clock that is never set, the clock of its publish time.
STEP_METADATA: Final[Mapping[str, str]] = {**WAIT_METADATA, "publish_time": "wall clock"}
MIN_WRITE_PERIOD_S: Final = 0.1
FLUSH_PERIOD_S: Final = 0.85  # with the gathering and the write, a crash loses at most a second
FILE_MODE: Final = 0o600  # positions are private
FOLDER_MODE: Final = 0o700
DAY_LENGTH_S: Final = 86_400.0
MIN_UNIX_TIME_S: Final = 1_735_689_600.0  # a clock before 2025 is not set
MAX_PAUSE_S: Final = 300 * DAY_LENGTH_S  # between two recordings: after more, the clock has more likely leapt
RECORDING: Final = "recording"  # of metadata
MAX_LABEL_BYTES: Final = 1 << 20  # a longer first record is not our label
MAX_UNLABELLED_NUMBER: Final = 1000  # versions without labels gave no higher number
CHUNK_BYTES: Final = 1 << 20
RECORDER_CAPACITY: Final = 20_000  # queued datagrams: half a minute of a busy flight, if the card stalls
MAX_CHANNEL_COUNT: Final = 10_000  # MCAP has 16 bits for channels; datagrams of further sources share OTHER_TOPIC
OTHER_TOPIC: Final = "others"
MAX_TARGETS: Final = 10_000  # estimates of further targets are not recorded: a replay computes them again


class Rotation(NamedTuple):
    """Limits at which a new file begins and older ones are removed; None is no limit."""

    file_bytes: float | None = None  # size at which a new file begins
    keep_bytes: float | None = None  # total size above which the oldest are removed
    keep_days: float | None = None  # age above which they are removed


DEFAULT_ROTATION: Final = Rotation()
NO_METADATA: Final[Mapping[str, Mapping[str, str]]] = {}


class Kept(NamedTuple):
    """A recording on the disk."""

    is_labelled: bool  # whether its metadata hold the number
    number: int
    path: Path
    size: int
    stamp: float  # Unix time, s


class Recorder:
    """A sink that writes `path`, or `path` with a number before its suffix.

    Each file begins with `metadata`, by name. `report`, called in the sink's thread, receives a line about each
    removed recording.
    """

    def __init__(
        self,
        path: Path,
        *,
        rotation: Rotation = DEFAULT_ROTATION,
        metadata: Mapping[str, Mapping[str, str]] = NO_METADATA,
        report: Callable[[str], None] = lambda _: None,
        monotonic: Callable[[], float] = time.monotonic,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._rotation = rotation
        self._metadata = metadata
        self._report = report
        self._run = secrets.token_hex(8)
        self.path = path  # of the file being written, once open
        self._wanted = path
        self._monotonic, self._now_ns = monotonic, now_ns
        self._encoder = msgspec.json.Encoder()
        self._file: IO[bytes] | None = None
        self._writer: Any = None
        self._channels: dict[tuple[str, str, bool], int] = {}  # by topic, encoding, stepped
        self._keys: dict[str, int] = {}  # channels of computed records
        self._schemas: dict[str, int] = {}
        self._is_kept = False  # a record has reached the disk
        self._unflushed = 0
        self._t_flush = 0.0
        self._t_recv_ns = 0
        self._step_ns = 0

    def check(self) -> None:
        """Check before the flight that the folder is writable, and create it if necessary.

        Raises SinkError.
        """
        folder = self._wanted.parent
        if self._wanted.is_dir():
            hint = f"it is a folder; name a file in it, such as {self._wanted / 'flight.mcap'}"
            raise SinkError(f"cannot record to {self._wanted}: {hint}")
        if self._wanted.exists() and not self._wanted.is_file():
            raise SinkError(f"cannot record to {self._wanted}: it is a device or a pipe; name a file on a disk")
        try:
            folder.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"cannot record to {self._wanted}: {error.strerror}") from error
        if not os.access(folder, os.W_OK | os.X_OK):
            raise SinkError(f"cannot record to {self._wanted}: {folder} is not writable")

    def open(self) -> None:
        """Create the file. Raises SinkError."""
        self.check()
        try:
            self.path, self._file = create(self._wanted)
        except OSError as error:
            raise SinkError(f"cannot record to {self._wanted}: {error.strerror}") from error
        self._channels, self._keys, self._schemas = {}, {}, {}
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._is_kept = False
        try:
            self._writer.start(library="onboard")
            number = str(_number_of(self._wanted, self.path.name) or 0)
            label = {"name": self.path.name, "number": number, "run": self._run}
            for name, data in ({RECORDING: label} | dict(self._metadata)).items():
                self._writer.add_metadata(name, dict(data))
            self._flush()
        except OSError as error:
            self._abandon()
            raise SinkError(f"cannot record to {self._wanted}: {error.strerror}") from error
        with suppress(OSError):  # recording comes first
            self._remove_old()

    def _remove_old(self) -> None:
        """Remove the oldest recordings beyond the limits of `Rotation`, never the open one."""
        limits, now, together = self._rotation, self._now_ns() * S_PER_NS, 0
        others = [one for one in recordings(self._wanted) if one.path != self.path]
        for one, made in reversed([*zip(others, latest_times(others, now), strict=True)]):
            together += one.size
            days = None if made is None else (now - made) / DAY_LENGTH_S
            if days is not None and limits.keep_days is not None and days > limits.keep_days:
                why = f"{days:.0f} days old; keep_days is {limits.keep_days:g}"
            elif limits.keep_bytes is not None and together > limits.keep_bytes:
                why = f"it and newer ones have {together * 1e-6:.0f} MB; keep_mb is {limits.keep_bytes * 1e-6:g}"
            else:
                continue
            one.path.unlink()
            self._report(f"recorder: removed {one.path}, {one.size * 1e-6:.1f} MB: {why}")

    def write(self, records: Sequence[Recorded]) -> None:
        """Append records; flush and sync `FLUSH_PERIOD_S` after the last time."""
        for record in records:
            if isinstance(record, Datagram):
                self._t_recv_ns = record.t_recv_ns
                self._step_ns = record.wall_step_ns or 0
                channel = self._channel(record.channel, record.encoding.value, record.wall_step_ns is not None)
                self._append(channel, record.data, record.waited_us)
            else:
                if isinstance(record, Health):
                    self._t_recv_ns = self._t_recv_ns or record.t_recv_ns  # before the first datagram
                computed = self._computed(record)
                if computed is not None:
                    self._append(computed, self._encoder.encode(record))
        if self._unflushed and self._monotonic() - self._t_flush >= FLUSH_PERIOD_S:
            self._flush()
            limit = self._rotation.file_bytes
            if limit is not None and self._file is not None and self._file.tell() > limit:
                self.close()
                self.open()

    def close(self) -> None:
        """Write the index and close the file.

        If the disk fails, as much as possible is saved, and a file without a record is removed.
        """
        if self._file is None:
            return
        try:
            self._writer.finish()
            self._file.flush()
            os.fdatasync(self._file.fileno())
            self._is_kept = True
        finally:
            self._abandon()

    def _abandon(self) -> None:
        """Close the file without an index, and remove it if no record has reached the disk."""
        file = self._file
        self._file = self._writer = None
        with suppress(OSError):  # closing flushes again, which fails again
            if file is not None:
                file.close()
        if not self._is_kept:
            with suppress(OSError):
                self.path.unlink()

    def _append(self, channel: int, data: bytes, waited_us: int = 0) -> None:
        """Append one message at the time of the latest datagram.

        A computed record thus gets the arrival time of the datagram that caused it. The publish time is the wall
        clock's.
        """
        self._writer.add_message(channel, self._t_recv_ns, data, self._t_recv_ns + self._step_ns, waited_us)
        self._unflushed += 1

    def _channel(self, topic: str, encoding: str, is_stepped: bool) -> int:
        """Return the channel of a source of datagrams.

        With `is_stepped` its datagrams carry the wall clock's steps.
        """
        channel = self._channels.get((topic, encoding, is_stepped))
        if channel is None:
            if len(self._channels) >= MAX_CHANNEL_COUNT and topic != OTHER_TOPIC:
                return self._channel(OTHER_TOPIC, encoding, is_stepped)
            metadata = dict(STEP_METADATA if is_stepped else WAIT_METADATA)
            channel = int(self._writer.register_channel(topic, encoding, 0, metadata))
            self._channels[topic, encoding, is_stepped] = channel
        return channel

    def _computed(self, record: Estimate | OwnPose | LeaderState | Health) -> int | None:
        """Return the channel of a computed record by its key, or None if there are too many keys."""
        key = key_of(record)
        channel = self._keys.get(key)
        if channel is None and len(self._keys) < MAX_TARGETS:
            channel = int(self._writer.register_channel(key, "json", self._schema(type(record))))
            self._keys[key] = channel
        return channel

    def _schema(self, record: type[Record]) -> int:
        name = record.__name__
        if name not in self._schemas:
            text = msgspec.json.encode(schema(record))
            self._schemas[name] = int(self._writer.register_schema(name, "jsonschema", text))
        return self._schemas[name]

    def _flush(self) -> None:
        assert self._file is not None  # noqa: S101 - write() follows open()
        self._writer.flush()
        os.fdatasync(self._file.fileno())
        self._is_kept = self._is_kept or self._unflushed > 0
        self._unflushed = 0
        self._t_flush = self._monotonic()


def runner(recorder: Recorder) -> SinkRunner[Recorded]:
    """Return the recorder with its queue, in which computed records give way to datagrams."""

    def gives_way(record: Recorded) -> bool:
        return not isinstance(record, Datagram)

    return SinkRunner("recorder", recorder, RECORDER_CAPACITY, gives_way=gives_way, gathers_s=MIN_WRITE_PERIOD_S)


def recordings(wanted: Path) -> list[Kept]:
    """Return the recordings made for the path `wanted`, oldest first.

    Unlabelled ones are ordered by stamp, since their numbers were reused, the others by number. Raises OSError.
    """
    found = []
    for path in wanted.parent.glob(f"*{wanted.suffix}"):
        number = _number_of(wanted, path.name)
        if number is None or path.is_symlink() or not path.is_file():
            continue
        label = _label(path)
        if label.get("name", path.name) == path.name and (label or number <= MAX_UNLABELLED_NUMBER):
            stat = path.stat()
            found.append(Kept(bool(label), number, path, stat.st_size, stat.st_mtime))
    return sorted(found, key=_order)


def _order(one: Kept) -> tuple[bool, float, int]:
    """Return the sort key for the order in which recordings were made.

    An unlabelled one stamped before the clock was set follows those stamped after it.
    """
    stamp = 0.0 if one.is_labelled else one.stamp if one.stamp > MIN_UNIX_TIME_S else math.inf
    return one.is_labelled, stamp, one.number


def latest_times(found: Sequence[Kept], now: float) -> list[float | None]:
    """Return the latest possible creation time of each recording, Unix s, in their order.

    It is None if unknown, and for all if the present time is unset. Before a leap of the clock none is known: by
    it, all recordings would be old.
    """
    times: list[float | None] = []
    newest = MIN_UNIX_TIME_S
    for one in found:
        is_believed = newest <= one.stamp <= now
        if is_believed and newest > MIN_UNIX_TIME_S and one.stamp - newest > MAX_PAUSE_S:
            times = [None] * len(times)
        newest = one.stamp if is_believed else newest
        times.append(newest if is_believed else None)
    if now - newest > MAX_PAUSE_S:
        return [None] * len(found)
    for i in reversed(range(len(times) - 1)):
        # The order of two unlabelled recordings is unknown unless both are stamped.
        if times[i] is None and (found[i].is_labelled or found[i + 1].is_labelled):
            times[i] = times[i + 1]
    return times


def _number_of(wanted: Path, name: str) -> int | None:
    """Return the number in a name made by this program for the path `wanted`, else None."""
    found = re.fullmatch(rf"{re.escape(wanted.stem)}(?:-([1-9]\d*))?{re.escape(wanted.suffix)}", name)
    if found is None or found[1] == "1":
        return None
    return int(found[1] or 1)


def _label(path: Path) -> dict[str, str]:
    """Return a recording's own metadata, empty if there are none or they cannot be read."""
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=MAX_LABEL_BYTES).records:
                if isinstance(record, Metadata) and record.name == RECORDING:
                    return dict(record.metadata)
                if not isinstance(record, Header):
                    break
    except (OSError, McapError, ValueError, struct.error):
        pass
    return {}


def create(wanted: Path) -> tuple[Path, IO[bytes]]:
    """Create a private file with the next number: `flight.mcap`, `flight-2.mcap` and so on.

    Raises OSError.
    """
    number = max((one.number for one in recordings(wanted)), default=0)
    while True:
        number += 1
        path = wanted if number == 1 else wanted.with_stem(f"{wanted.stem}-{number}")
        with suppress(FileExistsError):
            return path, os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, FILE_MODE), "wb")
