"""The flight recorder: every datagram as received, and the estimates, in an MCAP file.

Flushed records are synced to the disk: they survive a killed process and a loss of power. Such a recording ends
without an index; `onboard.wire.recording` reads it nevertheless. A recording is never overwritten: if the name
exists, the new file gets a number.
"""

import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import msgspec
from mcap.writer import Writer

from onboard.messages import Datagram, Estimate, Health, LeaderState, OwnPose, Record
from onboard.messages.schemas import key_of, schema
from onboard.sinks.sink import SinkError, SinkRunner

Recorded = Datagram | Estimate | OwnPose | LeaderState | Health

# of a channel of datagrams: what the numbers of its messages say
WAITED: Final[Mapping[str, str]] = {"sequence": "microseconds waited"}
# ... and whose log time is of a clock that is never set
STEPPED: Final[Mapping[str, str]] = {**WAITED, "publish_time": "wall clock"}
GATHERS_S: Final = 0.1  # records are written so often at most
FLUSH_S: Final = 0.85  # a crash loses at most a second: this, what is being gathered, and the writing
FILE_MODE: Final = 0o600  # where somebody flew is nobody else's business
FOLDER_MODE: Final = 0o700
S_PER_DAY: Final = 86_400.0
CHUNK_BYTES: Final = 1 << 20
CAPACITY: Final = 20_000  # queued datagrams: half a minute of a busy flight, if the card stalls
OWN_TOPICS: Final = 10_000  # MCAP numbers channels with 16 bits; datagrams of further sources share OTHERS, ...
OTHERS: Final = "others"
TARGETS: Final = 10_000  # ... and estimates of further targets are not recorded: a replay makes them again


class Rotation(NamedTuple):
    """When a new file begins, and which older ones are then removed: bytes of a file, bytes of all together, and
    days of age by their time stamps. None: never."""

    file_bytes: float | None = None
    keep_bytes: float | None = None
    keep_days: float | None = None


NO_ROTATION: Final = Rotation()
NOTHING: Final[Mapping[str, Mapping[str, str]]] = {}


class Recorder:
    """Sink that writes `path`, or `path` with a number before its suffix if that exists. Each file begins with
    `metadata`, by their names."""

    def __init__(
        self,
        path: Path,
        *,
        rotation: Rotation = NO_ROTATION,
        metadata: Mapping[str, Mapping[str, str]] = NOTHING,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._rotation = rotation
        self._metadata = metadata
        self.path = path  # of the file being written, once open
        self._wanted = path
        self._monotonic = monotonic
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
        """Check before the flight that the folder is writable; create it if necessary. Raises SinkError."""
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
            for name, data in self._metadata.items():
                self._writer.add_metadata(name, dict(data))
            self._flush()
        except OSError as error:
            self._abandon()
            raise SinkError(f"cannot record to {self._wanted}: {error.strerror}") from error
        with suppress(OSError):  # recording comes first
            self._remove_old()

    def _remove_old(self) -> None:
        """Remove the oldest recordings of this name, but not the open one, as `Rotation` says. Ages count from the
        open file's own stamp."""
        limits, name = self._rotation, re.compile(rf"{re.escape(self._wanted.stem)}(-\d+)?")
        now, left = self.path.stat().st_mtime, 0
        others = [p for p in self._wanted.parent.glob(f"*{self._wanted.suffix}") if name.fullmatch(p.stem)]
        found = sorted(
            ((p.stat(), p) for p in others if p != self.path), key=lambda f: f[0].st_mtime, reverse=True
        )
        for stat, path in found:
            left += stat.st_size
            is_old = limits.keep_days is not None and now - stat.st_mtime > limits.keep_days * S_PER_DAY
            if is_old or (limits.keep_bytes is not None and left > limits.keep_bytes):
                path.unlink()

    def write(self, records: Sequence[Recorded]) -> None:
        """Append records; flush and sync `FLUSH_S` after the last time."""
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
        if self._unflushed and self._monotonic() - self._t_flush >= FLUSH_S:
            self._flush()
            limit = self._rotation.file_bytes
            if limit is not None and self._file is not None and self._file.tell() > limit:
                self.close()
                self.open()

    def close(self) -> None:
        """Write the index and close the file. If the disk fails, as much as possible is saved, and a file without
        a record is removed."""
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
        """Close the file as it is. If no record has reached the disk, remove it: each retry makes another."""
        file = self._file
        self._file = self._writer = None
        with suppress(OSError):  # closing flushes again, which fails again
            if file is not None:
                file.close()
        if not self._is_kept:
            with suppress(OSError):
                self.path.unlink()

    def _append(self, channel: int, data: bytes, waited_us: int = 0) -> None:
        """Append one message at the time of the latest datagram: a computed record gets the arrival time of the
        datagram that caused it. The publish time is the wall clock's."""
        self._writer.add_message(channel, self._t_recv_ns, data, self._t_recv_ns + self._step_ns, waited_us)
        self._unflushed += 1

    def _channel(self, topic: str, encoding: str, is_stepped: bool) -> int:
        """The channel of a source of datagrams; `is_stepped`: they carry the wall clock's steps."""
        channel = self._channels.get((topic, encoding, is_stepped))
        if channel is None:
            if len(self._channels) >= OWN_TOPICS and topic != OTHERS:
                return self._channel(OTHERS, encoding, is_stepped)
            metadata = dict(STEPPED if is_stepped else WAITED)
            channel = int(self._writer.register_channel(topic, encoding, 0, metadata))
            self._channels[topic, encoding, is_stepped] = channel
        return channel

    def _computed(self, record: Estimate | OwnPose | LeaderState | Health) -> int | None:
        """The channel of a computed record by its key; None if there are too many keys."""
        key = key_of(record)
        channel = self._keys.get(key)
        if channel is None and len(self._keys) < TARGETS:
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
    """The recorder behind its queue, in which computed records give way to datagrams."""

    def gives_way(record: Recorded) -> bool:
        return not isinstance(record, Datagram)

    return SinkRunner("recorder", recorder, CAPACITY, gives_way=gives_way, gathers_s=GATHERS_S)


def create(wanted: Path) -> tuple[Path, IO[bytes]]:
    """A new file, not readable by everybody: `flight.mcap`, else `flight-2.mcap` and so on. Raises OSError."""
    path, number = wanted, 1
    while True:
        try:
            return path, os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, FILE_MODE), "wb")
        except FileExistsError:
            number += 1
            path = wanted.with_stem(f"{wanted.stem}-{number}")
