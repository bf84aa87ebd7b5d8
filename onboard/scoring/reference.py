"""Truth of the leader to compare estimates with, from a table or from a simulator's records."""

import csv
import gzip
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from onboard import UserError
from onboard.arrays import Array
from onboard.messages import Truth

TRUTH_COLUMNS: Final = {
    "r_north_m": "r_north",
    "r_east_m": "r_east",
    "r_down_m": "r_down",
    "v_north_m_s": "v_north",
    "v_east_m_s": "v_east",
    "v_down_m_s": "v_down",
    "size_m": "size",
    "a_lat_m_s2": "a_lat",
    "a_long_m_s2": "a_long",
}


class TruthError(UserError, ValueError):
    """The truth cannot be used; the message says why in one line."""


class Reference(NamedTuple):
    """A truth: times (n,) in s since boot, and values (n, k) of the named components."""

    time: Array
    components: tuple[str, ...]
    values: Array


def reference_from_csv(path: Path) -> Reference:
    """Read a truth from a CSV (or .csv.gz) with `time_boot_s` and the columns of a replay.

    Raises TruthError.
    """
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
        rows = list(csv.DictReader(text.splitlines()))
        names = tuple(c for c in TRUTH_COLUMNS if rows and c in rows[0])
        table = np.array([[float(row[c]) for c in ("time_boot_s", *names)] for row in rows])
    except OSError as error:
        raise TruthError(f"cannot read {path}: {error.strerror or error}") from error
    except (KeyError, TypeError, ValueError, EOFError) as error:
        raise TruthError(f"{path} is no truth table: {error}") from error
    if (
        not set(list(TRUTH_COLUMNS)[:7]) <= set(names)
        or not np.isfinite(table).all()
        or (np.diff(table[:, 0]) <= 0).any()
    ):
        raise TruthError(f"{path} is no truth table: it needs rising time_boot_s, r_, v_ and size_m")
    return Reference(table[:, 0], tuple(TRUTH_COLUMNS[c] for c in names), table[:, 1:])


def reference_from_records(truths: Iterable[Truth]) -> Reference:
    """Convert a simulator's records to a truth, in order of time, without duplicates."""
    rows = {t.t_ns: (*t.r_FL_n, *t.v_FL_n, t.size, t.a_lat, t.a_long) for t in truths}
    times = sorted(rows)
    values = np.array([rows[t] for t in times]).reshape(len(times), len(TRUTH_COLUMNS))
    return Reference(np.array(times) * 1e-9, tuple(TRUTH_COLUMNS.values()), values)
