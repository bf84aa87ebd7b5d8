"""Parts of work, computed in several processes or on a cluster."""

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from onboard.analysis.parallel.cluster import PROGRAM, STUDIES, on_cluster
from onboard.analysis.parallel.part_rows import PartRows
from onboard.analysis.parallel.processes import processes

Progress = Callable[[int, int], None]


class Computers(NamedTuple):
    """Processes here (`jobs`; None: one per core), or a Dask scheduler at an address."""

    jobs: int | None = None
    cluster: str = ""
    rows: Path | None = None  # a Parquet file for the results as they come


Jobs = Computers | int | None


class Part(NamedTuple):
    """Work for one process: a function of a module, and its arguments."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def compute(parts: Sequence[Part], jobs: Jobs = None, progress: Progress | None = None) -> list[Any]:
    """Compute all parts, in `jobs` processes (None: one per core) or where `Computers` says.

    Returns the results in order. `progress(done, total)` is called as parts finish. Raises ClusterError if a
    cluster cannot be used."""
    where = jobs if isinstance(jobs, Computers) else Computers(jobs)
    count = min(where.jobs or os.cpu_count() or 1, len(parts))
    results: Iterable[Any]
    with ExitStack() as stack:
        if where.cluster:
            roots = {part.function.__module__.partition(".")[0] for part in parts}
            results = on_cluster(where.cluster, _run, parts, [*PROGRAM, *roots & {STUDIES}])
        elif count <= 1:
            results = map(_run, parts)
        else:
            pool = stack.enter_context(processes(count))
            # Not `map`, which takes parts back if one raises: a pool that is stopped then raises in its thread.
            futures = [pool.submit(_run, part) for part in parts]
            results = (future.result() for future in futures)
        rows = stack.enter_context(PartRows(where.rows)) if where.rows is not None else None
        return _collect(results, parts, progress, rows)


def _run(part: Part) -> Any:
    return part.function(*part.arguments)


def _collect(
    results: Iterable[Any], parts: Sequence[Part], progress: Progress | None, rows: PartRows | None
) -> list[Any]:
    collected: list[Any] = []
    for part, result in zip(parts, results, strict=True):
        collected.append(result)
        if rows is not None:
            rows.add(part.function.__name__, part.arguments, result)
        if progress is not None:
            progress(len(collected), len(parts))
    return collected
