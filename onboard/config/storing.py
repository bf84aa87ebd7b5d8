"""Values set at run time, stored in a TOML file that overrides the configuration."""

import errno
import os
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from onboard.config.reading import ConfigError, read_toml
from onboard.config.sections import Config, LinkConfig
from onboard.sinks.secrets import is_private
from onboard.wire.mavlink.signing import read_key

HEAD: Final = "# Written by onboard: parameters that were set over MAVLink. They go over the configuration file.\n"
PERMISSIONS: Final = 0o640  # the group may read


def read_stored(path: Path) -> dict[str, Any]:
    """Return the stored values as a table, empty without a file. Raises ConfigError."""
    if not path.exists():
        return {}
    try:
        check_regular(path)
    except OSError as error:
        raise ConfigError(f"parameters.path: {path}: {error.strerror}") from error
    return read_toml(path)


def check_regular(path: Path) -> None:
    """Raise OSError unless this is a regular file: reading a pipe may block for ever."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "is not a regular file")


def check_storable(path: Path) -> None:
    """Raise ConfigError before the flight if the file cannot be written."""
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK | os.X_OK):
        raise ConfigError(f"parameters.path: the folder {path.parent} does not exist or is not writable")


def signing_key(link: LinkConfig) -> bytes | None:
    """Return the signing key of a link, or None without one.

    Raises ConfigError if the file cannot be used or is not private: anyone who reads the key can command the
    vehicle.
    """
    if link.key_file is None:
        return None
    where = f"link {link.name}: key_file {link.key_file}"
    path = Path(link.key_file)
    try:
        check_regular(path)
        is_ours = is_private(path) and path.stat().st_uid in {0, os.getuid()}
        key = read_key(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{where}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error
    if not is_ours:
        raise ConfigError(f"{where}: others can read it; run chmod 600 as its owner")
    if key is None:
        raise ConfigError(f"{where}: is empty; put 64 hexadecimal digits or a passphrase in it")
    return key


def store(path: Path, table: dict[str, Any]) -> None:
    """Write a table of numbers and arrays atomically, safe against power cuts.

    Raises OSError.
    """
    text = HEAD + "".join(f"{key} = {_toml(value)}\n" for key, value in _flat(table, ""))
    replace_file(path, text.encode(), PERMISSIONS, sync=True)


def replace_file(path: Path, data: bytes, mode: int, *, sync: bool) -> None:
    """Replace a file atomically; with `sync` it survives a power cut.

    A link or pipe of that name is not written to. Raises OSError.
    """
    new = path.with_name(f"{path.name}.new")
    try:
        new.unlink(missing_ok=True)
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(data)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        new.replace(path)
    except OSError:  # a full disk: remove the partial file, which uses the remaining space
        with suppress(OSError):
            new.unlink(missing_ok=True)
        raise


class Storing:
    """Stores tables in a thread, since an SD card takes tens of milliseconds.

    Of the tables that arrive meanwhile, the newest is stored. `what` names them in messages.
    """

    def __init__(
        self, path: Path, store_table: Callable[[Path, Any], None] = store, *, what: str = "parameters"
    ) -> None:
        self._path, self._store, self._what = path, store_table, what
        self._lock = threading.Lock()
        self._waiting: Any = None
        self._thread: threading.Thread | None = None
        self._error = ""

    def put(self, table: Any) -> None:
        """Queue a table for storage. Never waits for the disk."""
        with self._lock:
            self._waiting = table
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="storing", daemon=True)
                self._thread.start()

    def take_error(self) -> str:
        """Return once why the newest table could not be stored; "" otherwise."""
        with self._lock:
            error, self._error = self._error, ""
        return error

    def close(self) -> None:
        """Wait until all queued tables are stored or have failed."""
        with self._lock:
            thread = self._thread
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        """Store until the queue is empty."""
        while True:
            with self._lock:
                table, self._waiting = self._waiting, None
                if table is None:
                    self._thread = None
                    return
            try:
                self._store(self._path, table)
                error = ""
            except OSError as failed:
                error = f"{self._what} cannot be stored in {self._path}: {failed.strerror or failed}"
            with self._lock:
                self._error = error


def make_storing(config: Config) -> Storing | None:
    """Return the storage of parameters, or None without a path. Raises ConfigError."""
    if config.parameters.path is None:
        return None
    check_storable(Path(config.parameters.path))
    return Storing(Path(config.parameters.path))


def _flat(table: dict[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _toml(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(float(value))
