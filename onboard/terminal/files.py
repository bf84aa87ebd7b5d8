"""Files that commands write: checked before the work, not after a minute of it."""

import os
from pathlib import Path
from typing import Any

import msgspec

from onboard import UserError


def make_folder(folder: Path) -> None:
    """Raises UserError where it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot make the folder {folder}: {error.strerror}") from error


def check_targets(*targets: Path | None, inputs: tuple[Path | None, ...] = ()) -> None:
    """Raise UserError now for files that could not be written after a minute's work, or that are being read."""
    read = {path.resolve() for path in inputs if path is not None}
    for path in targets:
        if path is None:
            continue
        if path.resolve() in read:
            raise UserError(f"cannot write {path}: it is what is read")
        if path.is_dir():
            raise UserError(f"cannot write {path}: it is a folder")
        if not path.parent.is_dir():
            raise UserError(f"cannot write {path}: there is no folder {path.parent}")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise UserError(f"cannot write {path}: permission denied")


def write_json(path: Path, numbers: dict[str, Any]) -> None:
    """Write a summary as JSON. Raises UserError."""
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(numbers)) + b"\n")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from error
