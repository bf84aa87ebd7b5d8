"""Files that commands write, checked before the work begins."""

import os
from pathlib import Path
from typing import Any

import msgspec

from onboard import UserError


def make_folder(folder: Path) -> None:
    """Create a folder. Raises UserError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot create the folder {folder}: {error.strerror}") from error


def check_targets(*targets: Path | None, inputs: tuple[Path | None, ...] = ()) -> None:
    """Raise UserError for files that cannot be written, or that are inputs.

    It is called before work that may take minutes.
    """
    read = {path.resolve() for path in inputs if path is not None}
    for path in targets:
        if path is None:
            continue
        if path.resolve() in read:
            raise UserError(f"cannot write {path}: it is also an input; choose another name")
        if path.is_dir():
            raise UserError(f"cannot write {path}: it is a folder; name a file")
        if not path.parent.is_dir():
            raise UserError(f"cannot write {path}: the folder {path.parent} does not exist")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise UserError(f"cannot write {path}: permission denied")


def write_json(path: Path, numbers: dict[str, Any]) -> None:
    """Write a summary as JSON. Raises UserError."""
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(numbers)) + b"\n")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from error
