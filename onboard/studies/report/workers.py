"""The parts of a study in several processes, and what a study writes."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from onboard.studies.report.findings import Findings, markdown

Progress = Callable[[int, int], None]


class Part(NamedTuple):
    """Work for one process: a function of a module, and its arguments."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def compute(parts: Sequence[Part], jobs: int | None = None, progress: Progress | None = None) -> list[Any]:
    """What each part gives, in their order, computed in `jobs` processes (None: one per core).

    `progress(done, total)` is called as parts finish.
    """
    count = min(jobs or os.cpu_count() or 1, len(parts))
    found: list[Any] = []
    if count <= 1:
        for part in parts:
            found.append(part.function(*part.arguments))
            _tell(progress, len(found), len(parts))
        return found
    # spawned, not forked: whoever shows the progress may run threads
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        for result in pool.map(_run, parts):
            found.append(result)
            _tell(progress, len(found), len(parts))
    return found


def write(found: Findings, out: Path) -> None:
    """report.md and result.json into the folder `out`, NaN as null."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.md").write_text(markdown(found), encoding="utf-8")
    (out / "result.json").write_bytes(msgspec.json.format(msgspec.json.encode(found), indent=1))


def require_seeds(seeds: int, first_seed: int) -> range:
    """The seeds of a study. Raises ValueError."""
    if seeds < 1 or first_seed < 0:
        raise ValueError("needs at least one seed, none of them negative")
    return range(first_seed, first_seed + seeds)


def _run(part: Part) -> Any:
    return part.function(*part.arguments)


def _tell(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress(done, total)
