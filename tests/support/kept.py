"""Results that are computed once and kept on disk, under a digest of the sources that they depend on.

They are flights of simlink, which depend on scenario and seed alone, and a pipeline's outputs for a flight. They
are in `.pytest_cache`; a change of views, commands, links or documents invalidates none of them.
"""

import hashlib
import io
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import numpy as np
import pymavlink

from onboard.compiled.sources import name_of, needed_by, path_of
from onboard.messages import Datagram, TrafficTruth, Truth
from simlink.scenarios.scenario import Scenario
from simlink.simulation import CameraLink, datagrams
from tests.support.programs import ROOT

FOLDER: Final = ROOT / ".pytest_cache" / "flights"
SOURCES: Final = ("simlink", "onboard/messages", "onboard/wire", "onboard/geometry", "onboard/arrays.py")
OUTPUTS: Final = ROOT / ".pytest_cache" / "outputs"
MIN_COST_TIME_S: Final = 0.4  # of a core; cheaper results are computed again
Arriving = Datagram | Truth | TrafficTruth
T = TypeVar("T")


def flight(scenario: Scenario, seed: int, seconds: float | None, camera: CameraLink = "zenoh") -> list[Arriving]:
    """Return the output of `simlink.simulation.datagrams`."""
    asked = hashlib.sha256(repr((scenario, seed, seconds, camera)).encode()).hexdigest()
    return _kept(_folder() / asked[:32], lambda: [*datagrams(scenario, seed, seconds, camera=camera)], 0.0)


def flown(asked: object, fly: Callable[[], T]) -> T:
    """Return the result of `fly` for a pipeline and `asked`.

    These are all of its inputs apart from sources, so that nothing of these may be patched. Both must be
    picklable.
    """
    return _kept(_outputs() / hashlib.sha256(_bytes(asked)).hexdigest()[:32], fly, MIN_COST_TIME_S)


def _kept(path: Path, make: Callable[[], T], worth_s: float) -> T:
    if path.exists():
        kept: T = pickle.loads(path.read_bytes())  # noqa: S301 - our own
        return kept
    begin_s = time.process_time()
    made = make()
    if time.process_time() - begin_s >= worth_s:
        whole = path.with_suffix(f".{os.getpid()}")
        whole.write_bytes(pickle.dumps(made))
        whole.replace(path)
    return made


def _bytes(asked: object) -> bytes:
    """The same for equal values, whether they are one object or several."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, 5)
    pickler.fast = True
    pickler.dump(asked)
    return buffer.getvalue()


def digest(root: Path = ROOT) -> str:
    """SHA-256 of all sources, data and libraries from which flights are made."""
    found: list[Path] = []
    for part in SOURCES:
        files = sorted((root / part).rglob("*")) if (root / part).is_dir() else [root / part]
        found += (p for p in files if p.is_file() and p.suffix != ".pyc" and "__pycache__" not in p.parts)
    return _digest(root, found, (sys.version, np.__version__, msgspec.__version__))


def digest_of_what_flies() -> str:
    """SHA-256 of all modules that a pipeline may import, and of the libraries that it computes with."""
    libraries = (sys.version, np.__version__, msgspec.__version__, pymavlink.__version__)
    return _digest(ROOT, what_flies(), (libraries, os.environ.get("WINGLINE_KERNELS")))


def what_flies() -> list[Path]:
    """Every module that a pipeline may import, with whichever estimators."""
    folders = ("estimators", "filters")  # whose modules are loaded by name
    loaded = [name_of(path) for folder in folders for path in (ROOT / "onboard" / folder).rglob("*.py")]
    return sorted(path_of(name) for name in needed_by(["onboard.pipeline", *loaded]))


def _digest(root: Path, files: Iterable[Path], more: Any) -> str:
    found = hashlib.sha256(repr(more).encode())
    for path in files:
        found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


@cache
def _outputs() -> Path:
    return _only(OUTPUTS, digest_of_what_flies())


@cache
def _folder() -> Path:
    return _only(FOLDER, digest())


def _only(parent: Path, name: str) -> Path:
    """The folder of that name, without what others beside it hold."""
    folder = parent / name[:32]
    for other in parent.glob("*/*"):
        if other.parent != folder:
            other.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
