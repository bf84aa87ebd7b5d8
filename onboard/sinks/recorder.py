"""The flight recorder: every datagram as received, and the estimates beside it, in an MCAP file.

What was flushed survives the process being killed, and, being synced to the disk, the battery being pulled:
a recording then ends without an index and `onboard.wire.recording` reads it all the same. Nothing recorded is
ever overwritten: an existing name gets a number.
"""

import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final

import msgspec
from mcap.writer import Writer

from onboard.messages import Datagram, Estimate, Health, OwnPose
from onboard.messages.schemas import key_of, schema
from onboard.sinks.sink import SinkError

Recorded = Datagram | Estimate | OwnPose | Health

FLUSH_S: Final = 1.0  # what a crash may cost
CHUNK_BYTES: Final = 1 << 20
CAPACITY: Final = 20_000  # records waiting: half a minute of a busy flight, should the card stall


class Recorder:
    """Sink that writes `path`, or `path` with a number before its suffix if that exists already."""

    def __init__(self, path: Path, *, monotonic: Callable[[], float] = time.monotonic) -> None:
        self.path = path  # of the file being written, once open
        self._wanted = path
        self._monotonic = monotonic
        self._encoder = msgspec.json.Encoder()
        self._file: IO[bytes] | None = None
        self._writer: Any = None
        self._channels: dict[tuple[str, str], int] = {}
        self._unflushed = 0
        self._t_flush = 0.0
        self._t_recv_ns = 0

    def check(self) -> None:
        """Whether `open` will find a folder it can write to, asked before the flight. Raises SinkError."""
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
        """Append; flush and sync when the last time is `FLUSH_S` ago."""
        for record in records:
            if isinstance(record, Datagram):
                self._t_recv_ns = record.t_recv_ns
                channel = self._channel(record.channel, record.encoding.value, None)
                self._append(channel, record.data)
            else:
                channel = self._channel(key_of(record), "json", type(record))
                self._append(channel, self._encoder.encode(record))
        if self._unflushed and self._monotonic() - self._t_flush >= FLUSH_S:
            self._flush()

    def close(self) -> None:
        """Write the index and close; what can still be saved of a recording whose disk failed is saved."""
        file, writer = self._file, self._writer
        self._file = self._writer = None
        if file is None:
            return
        try:
            writer.finish()
            file.flush()
            os.fdatasync(file.fileno())
        finally:
            with suppress(OSError):  # closing flushes again what could not be written
                file.close()

    def _append(self, channel: int, data: bytes) -> None:
        """One message at the time of the latest datagram: a record that was computed is logged at the arrival
        that caused it."""
        self._writer.add_message(channel, self._t_recv_ns, data, self._t_recv_ns)
        self._unflushed += 1

    def _channel(self, topic: str, encoding: str, record: Any) -> int:
        channel = self._channels.get((topic, encoding))
        if channel is None:
            schema_id = 0
            if record is not None:
                text = msgspec.json.encode(schema(record))
                schema_id = self._writer.register_schema(record.__name__, "jsonschema", text)
            channel = int(self._writer.register_channel(topic, encoding, schema_id))
            self._channels[topic, encoding] = channel
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
