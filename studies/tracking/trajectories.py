"""The reference trajectories of the tracker papers: data/*.csv.gz of this package.

They have 10 Hz, east, north, up at the radar.
"""

import csv
import gzip
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from onboard.arrays import Array

COLUMNS = (
    "t_s",
    *(f"{kind}{axis}{unit}" for axis in "xyz" for kind, unit in (("", "_m"), ("v", "_m_s"), ("a", "_m_s2"))),
)


class Trajectory(NamedTuple):
    """Times (T,) s and states (T, 9): position, velocity, acceleration by axis, SI."""

    t: Array
    states: Array


def load(name: str) -> Trajectory:
    """Load `intruder-manoeuvring` (120 s) or `launch-vehicle` (500 s).

    The latter is a PSLV-like ascent from public stage data, a point mass over the rotating Earth. Raises
    ValueError if its columns are not COLUMNS.
    """
    packed = files("studies.tracking").joinpath(f"data/{name}.csv.gz").read_bytes()
    header, *rows = csv.reader(gzip.decompress(packed).decode("ascii").splitlines())
    if tuple(header) != COLUMNS:
        raise ValueError(f"{name}: columns {header}")
    table = np.array(rows, dtype=float)
    return Trajectory(table[:, 0], table[:, 1:])
