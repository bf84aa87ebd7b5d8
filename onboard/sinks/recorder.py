"""The flight recorder: every datagram as received, and the estimates, in an MCAP file.

Flushed records are synced to the disk: they survive a killed process and a loss of power. Such a recording ends
without an index; `onboard.wire.recording` reads it nevertheless. A recording is never overwritten: if the name
exists, the new file gets a number.
"""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final

import msgspec
from mcap.writer import Writer

from onboard.messages import Datagram, Estimate, Health, OwnPose
from onboard.messages.schemas import key_of, schema
from onboard.sinks.sink import SinkError

Recorded = Datagram | Estimate | OwnPose | Health

# of a channel whose messages' publish time is the wall clock's; their log time is of a clock that is never set
STEPPED: Final[Mapping[str, str]] = {"publish_time": "wall clock"}
NONE: Final[Mapping[str, str]] = {}
FLUSH_S: Final = 1.0  # a crash loses at most this much
CHUNK_BYTES: Final = 1 << 20
CAPACITY: Final = 20_000  # queued records: half a minute of a busy flight, if the card stalls


class Recorder:
    """Sink that writes `path`, or `path` with a number before its suffix if that exists."""

    def __init__(self, path: Path, *, monotonic: Callable[[], float] = time.monotonic) -> None:
        self.path = path  # of the file being written, once open
        self._wanted = path
        self._monotonic = monotonic
        self._encoder = msgspec.json.Encoder()
        self._file: IO[bytes] | None = None
        self._writer: Any = None
        self._channels: dict[tuple[str, str, bool], int] = {}
        self._unflushed = 0
        self._t_flush = 0.0
        self._t_recv_ns = 0
        self._step_ns = 0

    def check(self) -> None:
        """Check before the flight that the folder is writable; create it if necessary. Raises SinkError."""
        folder = self._wanted.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"cannot record to {self._wanted}: {error.strerror}") from error
        if not os.access(folder, os.W_OK | os.X_OK):
            raise SinkError(f"cannot record to {self._wanted}: {folder} is not writable")

    def open(self) -> None:
        """Create the file. Raises SinkError."""
        self.check()
        try:
            self.path, self._file = _create(self._wanted)
        except OSError as error:
            raise SinkError(f"cannot record to {self._wanted}: {error.strerror}") from error
        self._channels = {}
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(library="onboard")
        self._flush()

    def write(self, records: Sequence[Recorded]) -> None:
        """Append records; flush and sync `FLUSH_S` after the last time."""
        for record in records:
            if isinstance(record, Datagram):
                self._t_recv_ns = record.t_recv_ns
                self._step_ns = record.wall_step_ns or 0
                metadata = {} if record.wall_step_ns is None else STEPPED
                channel = self._channel(record.channel, record.encoding.value, None, metadata)
                self._append(channel, record.data)
            else:
                channel = self._channel(key_of(record), "json", type(record))
                self._append(channel, self._encoder.encode(record))
        if self._unflushed and self._monotonic() - self._t_flush >= FLUSH_S:
            self._flush()

    def close(self) -> None:
        """Write the index and close the file. If the disk fails, as much as possible is saved."""
        file, writer = self._file, self._writer
        self._file = self._writer = None
        if file is None:
            return
        try:
            writer.finish()
            file.flush()
            os.fdatasync(file.fileno())
        finally:
            with suppress(OSError):  # closing flushes again, which fails again
                file.close()

    def _append(self, channel: int, data: bytes) -> None:
        """Append one message at the time of the latest datagram: a computed record gets the arrival time of the
        datagram that caused it. The publish time is the wall clock's."""
        self._writer.add_message(channel, self._t_recv_ns, data, self._t_recv_ns + self._step_ns)
        self._unflushed += 1

    def _channel(self, topic: str, encoding: str, record: Any, metadata: Mapping[str, str] = NONE) -> int:
        key = topic, encoding, bool(metadata)
        channel = self._channels.get(key)
        if channel is None:
            schema_id = 0
            if record is not None:
                text = msgspec.json.encode(schema(record))
                schema_id = self._writer.register_schema(record.__name__, "jsonschema", text)
            channel = int(self._writer.register_channel(topic, encoding, schema_id, dict(metadata)))
            self._channels[key] = channel
        return channel

    def _flush(self) -> None:
        assert self._file is not None  # noqa: S101 - write() follows open()
        self._writer.flush()
        os.fdatasync(self._file.fileno())
        self._unflushed = 0
        self._t_flush = self._monotonic()


def _create(wanted: Path) -> tuple[Path, IO[bytes]]:
    """A new file: `flight.mcap`, else `flight-2.mcap` and so on. Raises OSError."""
    path, number = wanted, 1
    while True:
        try:
            return path, path.open("xb")
        except FileExistsError:
            number += 1
            path = wanted.with_stem(f"{wanted.stem}-{number}")
