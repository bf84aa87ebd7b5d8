"""Computers that fly many flights, by `--jobs`, `--cluster` and `--rows`."""

from importlib.util import find_spec
from pathlib import Path

from onboard import UserError, with_extra
from onboard.analysis.parallel.workers import Computers
from onboard.terminal.files import check_targets


def computers(jobs: int | None, cluster: str | None, rows: Path | None) -> Computers:
    """Choose the computers by `--jobs`, `--cluster` and `--rows`. Raises UserError if a library is missing."""
    check_targets(rows)
    if rows is not None and find_spec("pyarrow") is None:
        raise UserError(f"cannot write {rows}: it needs pyarrow: {with_extra('cluster')}")
    return Computers(jobs=jobs, cluster=cluster or "", rows=rows)
