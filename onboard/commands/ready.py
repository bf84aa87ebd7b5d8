"""A record of the kernels that are ready: to load them all, only to see that they are, takes seconds of a core.

There is one for each precision. It holds while all sources have these sizes and times of change, for this
processor, and these versions and settings of Numba. A module whose machine code has changed since is not ready.
"""

import hashlib
import os
import platform
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard.filters import numba_internals, shipped

ALL: Final = "all"  # what is asked for where no modules are named


def path_in(folder: Path) -> Path:
    """The file of the record for the precision of this process."""
    return folder / f"kernels-ready-{os.environ.get('WINGLINE_PRECISION', 'both')}.json"


class Module(NamedTuple):
    """A module whose kernels are ready: how many variants (of argument types) were loaded and how many
    compiled, in how many seconds, and the folder of the machine code."""

    name: str
    loaded: int
    compiled: int
    seconds: float
    folder: str


class Kept(msgspec.Struct, frozen=True):
    """A module, None if its kernels are only compiled where others call them, and its files of machine code."""

    module: Module | None
    files: list[tuple[str, int, int]]


class Ready(msgspec.Struct):
    """For one digest of all that machine code depends on: which modules with kernels a question is about, and
    those that are ready."""

    digest: str
    asked: dict[str, list[str]] = {}
    modules: dict[str, Kept] = {}

    def has(self, name: str) -> bool:
        """Whether a module is ready, and its machine code as it was."""
        kept = self.modules.get(name)
        return kept is not None and kept.files == stamps(Path(path) for path, *_ in kept.files)

    def keep(self, name: str, module: Module | None, code: Iterable[Path]) -> None:
        """A module is ready now."""
        if module is not None:
            module = module._replace(loaded=module.loaded + module.compiled, compiled=0, seconds=0.0)
        self.modules[name] = Kept(module, stamps(code))


def read(folder: Path, digest: str) -> Ready:
    """The record in a folder; an empty one if there is none for this digest."""
    try:
        found = msgspec.json.decode(path_in(folder).read_bytes(), type=Ready)
    except (OSError, msgspec.DecodeError):
        return Ready(digest)
    return found if found.digest == digest else Ready(digest)


def write(folder: Path, ready: Ready) -> None:
    """Keep the record in a folder. Raises OSError."""
    path = path_in(folder)
    whole = path.with_suffix(f".{os.getpid()}")
    whole.write_bytes(msgspec.json.encode(ready))
    whole.replace(path)


def digest(folders: Iterable[Path]) -> str:
    """SHA-256 of the sources' paths, sizes and times, and of what else machine code depends on."""
    files = [*shipped.FOLDER.rglob("*.*"), *(path for folder in folders for path in folder.rglob("*.py"))]
    settings = sorted((k, v) for k, v in os.environ.items() if k.startswith("NUMBA_"))
    processor = (platform.machine(), sorted(numba_internals.processor_features()), numba_internals.asked_for())
    versions = numba_internals.compiler_versions()
    return hashlib.sha256(repr((settings, processor, versions, stamps(sorted(files)))).encode()).hexdigest()


def stamps(files: Iterable[Path]) -> list[tuple[str, int, int]]:
    """Path, size and time of change (ns) of each file that is there."""
    found: list[tuple[str, int, int]] = []
    for path in files:
        if path.exists():
            stat = path.stat()
            found.append((str(path), stat.st_size, stat.st_mtime_ns))
    return found
