"""Published records with arbitrary contents."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from onboard.messages import Estimate, Lifecycle, OwnPose
from onboard.sinks.recorder import Recorder
from onboard.wire.logs.recording import read_flown


def make_estimate(sequence: int = 1, name: str = "ukf", **changed: Any) -> Estimate:
    """A valid estimate with two components."""
    fields: dict[str, Any] = {
        "name": name,
        "target": name,
        "sequence": sequence,
        "t_ns": sequence * 10**8,
        "state": Lifecycle.TRACKING,
        "valid": True,
        "reason": "",
        "frame": "n",
        "components": ("x", "y"),
        "units": ("m", "m"),
        "mean": (0.1 + sequence, -1e-300),
        "covariance": ((1.0, 0.5), (0.5, 1.0)),
        "age": 0.01,
        "reset_count": 0,
    }
    return Estimate(**fields | changed)


POSE = OwnPose(t_ns=1, r_OF_n=(1, 2, 3), v_F_n=(4, 5, 6), a_F_n=(7, 8, 9), q_nb=(1, 0, 0, 0))


def read_estimates(path: Path) -> Iterator[Estimate]:
    """The estimates that were made during a recording, but our own states."""
    return (item for item, _ in read_flown(path, {"estimate": Estimate}) if isinstance(item, Estimate))


def record(path: Path, written: Sequence[Any], **options: Any) -> Path:
    """Record these datagrams and records to a new file, and return its path."""
    recorder = Recorder(path, **options)
    recorder.open()
    recorder.write(written)
    recorder.close()
    return recorder.path
