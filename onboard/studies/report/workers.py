"""The parts of a study, computed in several processes; the files that a study writes."""

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from onboard.messages import Record
from onboard.studies.report.findings import Findings
from onboard.studies.report.markdown import markdown
from onboard.studies.report.processes import processes

Progress = Callable[[int, int], None]


class Part(NamedTuple):
    """Work for one process: a function of a module, and its arguments."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def compute(parts: Sequence[Part], jobs: int | None = None, progress: Progress | None = None) -> list[Any]:
    """The result of each part, in their order, computed in `jobs` processes (None: one per core).

    `progress(done, total)` is called as parts finish.
    """
    count = min(jobs or os.cpu_count() or 1, len(parts))
    if count <= 1:
        return _collect(map(_run, parts), len(parts), progress)
    with processes(count) as pool:
        return _collect(pool.map(_run, parts), len(parts), progress)


def write(found: Findings, out: Path, result: Record | None = None) -> None:
    """report.md and result.json into the folder `out`. The JSON holds `result` (None: `found`), NaN as null."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.md").write_text(markdown(found), encoding="utf-8")
    (out / "result.json").write_bytes(
        msgspec.json.format(msgspec.json.encode(found if result is None else result), indent=1)
    )


def require_seeds(seeds: int, first_seed: int) -> range:
    """The seeds of a study. Raises ValueError."""
    if seeds < 1 or first_seed < 0:
        raise ValueError("needs at least one seed, none of them negative")
    return range(first_seed, first_seed + seeds)


def _run(part: Part) -> Any:
    return part.function(*part.arguments)


def _collect(results: Iterable[Any], total: int, progress: Progress | None) -> list[Any]:
    found: list[Any] = []
    for result in results:
        found.append(result)
        if progress is not None:
            progress(len(found), total)
    return found
