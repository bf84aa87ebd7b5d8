"""Recorded streams of real autopilots behind a leader, drawn as a map and a range.

The recordings are not part of the repository: without `../shared/data` nothing is drawn.
"""

import csv
import gzip
import math
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from drawings import PICTURES

from onboard.arrays import Array
from onboard.config import load_config
from onboard.messages import Estimate, OwnPose
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog

DATA: Final = Path(__file__).parents[2] / "shared" / "data"
FILE_NAME: Final = "real-flights.png"
SETTINGS: Final = ("camera.mount_rpy_deg=[0,15,0]", "estimator.leader.size_prior_m=2.0")
SIGMAS: Final = 2.0
BLUE, AMBER, BLACK = "#2f6fd0", "#c77d0a", "#222222"


class Recording(NamedTuple):
    """A follower's stream below DATA, its truth, and the interval that is drawn (s)."""

    title: str
    log: str
    truth: str
    begin: float
    end: float


RECORDINGS: Final = (
    Recording(
        "ArduCopter 4.7-dev, circles to both sides at 12 m/s",
        "formation-copter/follower.tlog",
        "formation-copter/follower_truth.csv.gz",
        5.0,
        250.0,
    ),
    Recording(
        "PX4 1.17, straight legs and circles at up to 8 m/s",
        "px4-formation/follower.tlog.gz",
        "px4-formation/follower_truth.csv.gz",
        5.0,
        400.0,
    ),
)


class Drawn(NamedTuple):
    """The positions and ranges to draw."""

    t: Array  # (n,), s
    follower: Array  # (n, 3), NED, m
    estimate: Array  # (n, 3), of the leader
    truth: Array  # (n, 3), of the leader
    range_m: Array  # (n,), estimated
    sigma_m: Array  # (n,), of the range


def main() -> bool:
    """Draw all recordings into docs/pictures; return False if they are not available."""
    if not all((DATA / one.log).exists() for one in RECORDINGS):
        return False
    mpl.use("agg")
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(9.6, 6.2), dpi=110, layout="constrained")
    axes = figure.subplots(2, 2, width_ratios=(1, 1.5))
    for (top, side), recording in zip(axes, RECORDINGS, strict=True):
        _draw(top, side, recording, flown(recording))
    figure.savefig(PICTURES / FILE_NAME)
    return True


def flown(recording: Recording) -> Drawn:
    """Run a recording through the pipeline, and align it with its truth."""
    pipeline = Pipeline(load_config(None, SETTINGS))
    poses: list[tuple[float, ...]] = []
    rows: list[tuple[float, ...]] = []
    for datagram, _ in read_tlog(_read(DATA / recording.log)):
        for record in () if datagram is None else pipeline.feed(datagram):
            if isinstance(record, OwnPose):
                poses.append((record.t_ns * 1e-9, *(math.nan if x is None else x for x in record.r_OF_n)))
            if isinstance(record, Estimate) and record.valid and record.mean and record.covariance:
                rows.append((record.t_ns * 1e-9, *record.mean[:3], _range_sigma(record)))
    with gzip.open(DATA / recording.truth, "rt") as file:
        names = ("time_boot_s", "r_north_m", "r_east_m", "r_down_m")
        true = np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])
    table, own = np.array(rows), np.array(poses)
    own = own[np.isfinite(own).all(axis=1)]
    began = true[0, 0]
    table = table[(table[:, 0] > began + recording.begin) & (table[:, 0] < began + recording.end)]
    t = table[:, 0]
    follower, relative = _at(t, own), _at(t, true)
    r = table[:, 1:4]
    return Drawn(t - began, follower, follower + r, follower + relative, np.linalg.norm(r, axis=1), table[:, 4])


def _read(path: Path) -> bytes:
    data = path.read_bytes()
    return gzip.decompress(data) if path.suffix == ".gz" else data


def _range_sigma(estimate: Any) -> float:
    """Return one standard deviation of the range, m."""
    r = np.array(estimate.mean[:3])
    u = r / np.linalg.norm(r)
    return float(np.sqrt(u @ np.array(estimate.covariance)[:3, :3] @ u))


def _at(t: Array, table: Array) -> Array:
    return np.column_stack([np.interp(t, table[:, 0], column) for column in table[:, 1:4].T])


def _draw(top: Any, side: Any, recording: Recording, drawn: Drawn) -> None:
    for axis in (top, side):
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.tick_params(labelsize=8)
    top.plot(drawn.follower[:, 1], drawn.follower[:, 0], color=AMBER, linewidth=0.9, label="follower")
    top.plot(drawn.truth[:, 1], drawn.truth[:, 0], color=BLACK, linewidth=1.6, label="leader, truth")
    top.plot(drawn.estimate[:, 1], drawn.estimate[:, 0], color=BLUE, linewidth=0.8, label="leader, estimate")
    top.set_aspect("equal", adjustable="datalim")
    top.set_xlabel("east [m]", fontsize=8)
    top.set_ylabel("north [m]", fontsize=8)
    top.legend(fontsize=7, frameon=False, loc="best")
    true_range = np.linalg.norm(drawn.truth - drawn.follower, axis=1)
    low, high = drawn.range_m - SIGMAS * drawn.sigma_m, drawn.range_m + SIGMAS * drawn.sigma_m
    side.fill_between(drawn.t, low, high, color=BLUE, alpha=0.2, linewidth=0, label=f"±{SIGMAS:g}σ")
    side.plot(drawn.t, drawn.range_m, color=BLUE, linewidth=0.9, label="estimate")
    side.plot(drawn.t, true_range, color=BLACK, linewidth=1.1, linestyle=(0, (4, 2)), label="truth")
    side.set_ylim(0, 1.25 * float(np.percentile(high, 99)))
    side.set_xlabel("time [s]", fontsize=8)
    side.set_ylabel("range [m]", fontsize=8)
    side.set_title(recording.title, fontsize=9, loc="left")
    side.legend(fontsize=7, frameon=False, ncol=3, loc="lower right")


if __name__ == "__main__":
    main()
