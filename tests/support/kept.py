"""Flights of simlink, simulated once: a run depends on scenario and seed alone, so its items are kept on disk,
under a digest of all sources that they depend on. They are in `.pytest_cache`, without those of other sources."""

import hashlib
import os
import pickle
import sys
from functools import cache
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from onboard.messages import Datagram, TrafficTruth, Truth
from simlink.scenarios.scenario import Scenario
from simlink.simulation import CameraLink, datagrams
from tests.support.programs import ROOT

FOLDER: Final = ROOT / ".pytest_cache" / "flights"
SOURCES: Final = ("simlink", "onboard/messages", "onboard/wire", "onboard/geometry", "onboard/arrays.py")
Arriving = Datagram | Truth | TrafficTruth


def flight(scenario: Scenario, seed: int, seconds: float | None, camera: CameraLink = "zenoh") -> list[Arriving]:
    """What `simlink.simulation.datagrams` gives."""
    asked = hashlib.sha256(repr((scenario, seed, seconds, camera)).encode()).hexdigest()
    path = _folder() / asked[:32]
    if path.exists():
        kept: list[Arriving] = pickle.loads(path.read_bytes())  # noqa: S301 - our own
        return kept
    made = [*datagrams(scenario, seed, seconds, camera=camera)]
    whole = path.with_suffix(f".{os.getpid()}")
    whole.write_bytes(pickle.dumps(made))
    whole.replace(path)
    return made


def digest(root: Path = ROOT) -> str:
    """SHA-256 of all sources, data and libraries from which flights are made."""
    found = hashlib.sha256(repr((sys.version, np.__version__, msgspec.__version__)).encode())
    for part in SOURCES:
        files = sorted((root / part).rglob("*")) if (root / part).is_dir() else [root / part]
        for path in (p for p in files if p.is_file() and p.suffix != ".pyc" and "__pycache__" not in p.parts):
            found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


@cache
def _folder() -> Path:
    folder = FOLDER / digest()[:32]
    for other in FOLDER.glob("*/*"):
        if other.parent != folder:
            other.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
