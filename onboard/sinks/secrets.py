"""Files with secrets, keys and passwords, which nobody else may read."""

import os
import stat
from pathlib import Path
from typing import Final

from onboard.sinks.sink import SinkError

CREDENTIALS: Final = "CREDENTIALS_DIRECTORY"  # systemd's folder of credentials, private to the service


def secret(path: str, key: str) -> str:
    """Return the stripped text of the private file named by the configuration's `key`.

    Raises SinkError if it cannot be read or is empty, or if others can read it.
    """
    file = Path(path)
    try:
        is_open = not (file.is_dir() or is_private(file))
        text = "" if is_open else file.read_text(encoding="utf-8-sig").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not text"
        raise SinkError(f"{key} {path}: {reason}") from error
    if is_open:
        raise SinkError(f"{key} {path}: others can read it; run chmod 600 on it")
    if not text:
        raise SinkError(f"{key} {path}: is empty")
    return text


def is_private(file: Path) -> bool:
    """Whether a file is regular and only its owner and root can read it.

    systemd's credentials may belong to root, with an access list for the service's user that appears as a right of
    root's group. Raises OSError.
    """
    mode, credentials = file.stat().st_mode, os.environ.get(CREDENTIALS)
    if credentials and file.resolve().is_relative_to(Path(credentials).resolve()):
        return stat.S_ISREG(mode) and not Path(credentials).stat().st_mode & stat.S_IRWXO
    return stat.S_ISREG(mode) and not mode & (stat.S_IRWXG | stat.S_IRWXO)
