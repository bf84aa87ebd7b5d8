"""Recordings of `onboard` (MCAP): every datagram bit for bit, and the estimates as JSON.

A channel whose message encoding is one of `Encoding` holds datagrams: its topic is their channel, the log time
their arrival, ns, the publish time that arrival by the wall clock, and the sequence their wait in this program,
microseconds. The channel's metadata state which of them it has. A channel of encoding "json" holds published
records; its topic is their key. Metadata named CONFIGURATION, at the start, hold the flight's configuration as
JSON.
"""

import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import msgspec
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from onboard.messages import Datagram, Encoding, Estimate, NavState
from onboard.wire.logs.tlog import NotALogError

MAGIC: Final = b"\x89MCAP0\r\n"
JSON: Final = "json"
CONFIGURATION: Final = "configuration"  # of metadata
RECORDING: Final = "recording"  # of metadata: the file's name, its number, and the run, of which it may be a part
MAX_RECORD_BYTES: Final = 256 << 20  # a longer record is damaged
DAMAGE: Final = (McapError, ValueError, OverflowError, MemoryError, struct.error)
MADE: Final[Mapping[str, type[Estimate]]] = {"estimate": Estimate, "own_state": NavState}
ENCODINGS: Final = {encoding.value: encoding for encoding in Encoding}


def is_recording(path: Path) -> bool:
    """Whether the file starts as a recording does. Raises OSError when it cannot be read."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def read_configuration(path: Path) -> bytes | None:
    """Read the configuration in a recording, as JSON; None without one. Raises OSError."""
    found = _metadata(path, CONFIGURATION)
    return None if found is None else found.get(JSON, "").encode()


def parts_of(path: Path) -> tuple[Path, ...]:
    """A log and the following parts of its run, if it is a recording that was divided by size.

    Raises OSError.
    """
    label = _metadata(path, RECORDING) or {}
    if not label.get("run"):
        return (path,)
    numbered = {}
    for other in path.parent.glob(f"*{path.suffix}"):
        theirs = {} if other.is_symlink() else _metadata(other, RECORDING) or {}
        if theirs.get("run") == label["run"] and theirs.get("number", "").isdecimal():
            numbered[int(theirs["number"])] = other
    return (path, *(numbered[number] for number in sorted(numbered) if number > int(label["number"])))


def _metadata(path: Path, name: str) -> dict[str, str] | None:
    """Read the metadata of that name at a file's start; None if there are none."""
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return None
        try:
            for record in StreamReader(file, skip_magic=True, record_size_limit=MAX_RECORD_BYTES).records:
                if isinstance(record, Metadata) and record.name == name:
                    return dict(record.metadata)
                if not isinstance(record, Header | Metadata):
                    return None
        except DAMAGE:
            return None
    return None


def read_recording(path: Path) -> Iterator[tuple[Datagram | None, int]]:
    """Read (Datagram, bytes consumed so far), (None, ...) once for each unreadable stretch.

    Raises NotALogError at once when the file is not an MCAP file, OSError when it cannot be read.
    """
    return ((item, at) for item, at in read_flown(path, {}) if not isinstance(item, Estimate))


def read_flown(
    path: Path, made: Mapping[str, type[Estimate]] = MADE
) -> Iterator[tuple[Datagram | Estimate | None, int]]:
    """Read datagrams as `read_recording`, and the estimates whose keys begin as in `made`.

    An estimate of another version of its record is left out. Raises NotALogError at once when the file is not an
    MCAP file, OSError when it cannot be read.
    """
    lost = False
    decoders = {begin: msgspec.json.Decoder(record) for begin, record in made.items()}
    for item, at in _read(path):
        if item is None:
            if not lost:
                yield None, at
            lost = True
            continue
        lost = False
        channel, message = item
        encoding = ENCODINGS.get(channel.message_encoding)
        if encoding is not None:
            yield _datagram(channel, encoding, message), at
        elif (decoder := decoders.get(channel.topic.partition("/")[0])) is not None:
            with suppress(msgspec.DecodeError):
                yield decoder.decode(message.data), at


def read_messages(path: Path) -> Iterator[tuple[Any, Any, Any] | None]:
    """Read mcap's (schema or None, channel, message) of a file; None for each unreadable part.

    Raises NotALogError, OSError.
    """
    schemas: dict[int, Any] = {}
    for item, _ in _read(path, schemas):
        yield None if item is None else (schemas.get(item[0].schema_id), *item)


def _datagram(channel: Channel, encoding: Encoding, message: Any) -> Datagram:
    """The datagram of a message; the channel's metadata state which of its times are valid."""
    step_ns = message.publish_time - message.log_time if "publish_time" in channel.metadata else None
    return Datagram(
        channel=channel.topic,
        encoding=encoding,
        t_recv_ns=message.log_time,
        data=message.data,
        wall_step_ns=step_ns,
        waited_us=message.sequence if "sequence" in channel.metadata else 0,
    )


def _read(path: Path, schemas: dict[int, Any] | None = None) -> Iterator[tuple[tuple[Any, Any] | None, int]]:
    """Read ((channel, message), bytes consumed) in file order, (None, ...) for a bad part.

    Schemas are put into `schemas` by their number.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise NotALogError(f"{path.name}: this is not a recording: it does not begin as an MCAP file does")
        reader = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
        channels: dict[int, Any] = {}
        ended = False
        try:
            for record in reader.records:
                ended = isinstance(record, Footer)
                for item in _messages(record, channels, {} if schemas is None else schemas):
                    yield item, file.tell()
        except DAMAGE:  # cut off, or a length that is damaged
            ended = False
        if not ended:
            yield None, path.stat().st_size


def _messages(record: Any, channels: dict[int, Any], schemas: dict[int, Any]) -> list[tuple[Any, Any] | None]:
    """The messages of one record with their channels; None for an unreadable one."""
    try:
        parts = breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]
    except Exception:  # a decompressor may raise anything on damaged bytes
        return [None]
    found: list[tuple[Any, Any] | None] = []
    for part in parts:
        if isinstance(part, Channel):
            channels[part.id] = part
        elif isinstance(part, Schema):
            schemas[part.id] = part
        elif isinstance(part, Message):
            channel = channels.get(part.channel_id)
            found.append(None if channel is None else (channel, part))
    return found
