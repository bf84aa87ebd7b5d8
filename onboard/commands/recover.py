"""`onboard recover`: a recording of a killed program written anew, with the end and the index that it lacks.

`onboard replay` needs neither. Other programs' readers do.
"""

import argparse
import os
from pathlib import Path
from typing import Any, Final

from mcap.writer import Writer

from onboard import UserError
from onboard.terminal.output import show
from onboard.wire.logs.recording import CONFIGURATION, JSON, is_recording, read_configuration, read_messages

MAGIC: Final = b"\x89MCAP0\r\n"  # at the begin and the end of a file
FILE_MODE: Final = 0o600  # as the recorder's


def main(arguments: argparse.Namespace) -> int:
    """Write what can be read of a recording to a new file. Raises UserError."""
    source: Path = arguments.recording
    try:
        if not is_recording(source):
            raise UserError(f"{source} is no recording of ours (.mcap)")
        wanted = arguments.out or source.with_stem(f"{source.stem}-recovered")
        has_end = is_ended(source)
        count, damaged = recover(source, wanted)
    except FileExistsError as error:
        raise UserError(f"{wanted} exists already; name another file with --out") from error
    except OSError as error:
        raise UserError(f"cannot recover {source}: {error.strerror or error}") from error
    stretches = "1 stretch" if damaged == 1 else f"{damaged} stretches"
    show(f"{wanted}: {count} records; {stretches} could not be read")
    if not has_end:
        show(f"{source} has no end: what wrote it was killed. `onboard` reads it; others want {wanted.name}")
    return 0


def is_ended(source: Path) -> bool:
    """Whether a recording was closed: without its end, and the index before it, other programs refuse it. Raises
    OSError."""
    with source.open("rb") as file:
        file.seek(-min(len(MAGIC), source.stat().st_size), os.SEEK_END)
        return file.read() == MAGIC


def recover(source: Path, target: Path) -> tuple[int, int]:
    """(records written, stretches that could not be read). Raises NotALogError, OSError, FileExistsError."""
    count = damaged = 0
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    with os.fdopen(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, FILE_MODE), "wb") as file:
        writer: Any = Writer(file)
        writer.start(library="onboard")
        if (configuration := read_configuration(source)) is not None:
            writer.add_metadata(CONFIGURATION, {JSON: configuration.decode()})
        for item in read_messages(source):
            if item is None:
                damaged += 1
                continue
            schema, channel, message = item
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                number = schemas.get(channel.schema_id, 0)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
            count += 1
        writer.finish()
    return count, damaged
