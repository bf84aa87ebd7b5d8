"""All studies, two at a time, each with half of the cores: one draws while the other computes."""

import os
import signal
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from importlib import import_module
from multiprocessing.managers import SyncManager
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any, Final

import msgspec

import studies
from onboard.analysis.parallel.processes import CONTEXT, end_with_parent, processes
from onboard.analysis.parallel.workers import Progress

PROCESS_COUNT: Final = 2
# the slowest first (as measured), so that the last ones are short
SLOWEST: Final = (
    *("relative-motion", "csvsf-quadrotor", "traffic", "encounters", "manoeuvres", "own-state"),
    *("closed-loop", "joseph-srukf-sense-and-avoid", "ukf-radar-launch-vehicle"),
)

StudyProgress = Callable[[str, int, int], None]


def run_study(name: str, given: Mapping[str, Any], out: Path, progress: Progress) -> dict[str, Any]:
    """Run a study, and return its result as plain values; its files go to a folder of `out`.

    `given` has seeds, first_seed and jobs (by default one process for each core). Raises ImportError if figures
    cannot be drawn.
    """
    module = import_module(f"{studies.__name__}.{name.replace('-', '_')}.study")
    result: dict[str, Any] = msgspec.to_builtins(module.run(**given, out=out / name, progress=progress))
    return result


def run_all(
    names: Sequence[str], seeds: int | None, out: Path, on_progress: StudyProgress
) -> dict[str, dict[str, Any]]:
    """Run every study of these names; the results are in their order.

    `on_progress(name, done, total)` is called, from a thread, as parts finish. If a study raises, this raises the
    same and begins no other.
    """
    order = sorted(names, key=lambda name: SLOWEST.index(name) if name in SLOWEST else len(SLOWEST))
    results: dict[str, dict[str, Any]] = {}
    manager = SyncManager(ctx=CONTEXT)
    manager.start(_begin)
    with manager, processes(PROCESS_COUNT) as pool:
        queue: Queue[tuple[str, int, int] | None] = manager.Queue()
        listener = Thread(target=_listen, args=(queue, on_progress), daemon=True)
        listener.start()
        running = {pool.submit(_run_in_child, queue, name, seeds, out): name for name in order}
        try:
            for done in as_completed(running):
                results[running[done]] = done.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            queue.put(None)
            listener.join()
    return {name: results[name] for name in names}


def _run_in_child(
    queue: "Queue[tuple[str, int, int] | None]", name: str, seeds: int | None, out: Path
) -> dict[str, Any]:
    jobs = max(1, (os.cpu_count() or 1) // PROCESS_COUNT)  # with one, a study starts no process of its own
    given = {"jobs": jobs} if seeds is None else {"jobs": jobs, "seeds": seeds}
    return run_study(name, given, out, lambda done, total: queue.put((name, done, total)))


def _begin() -> None:
    end_with_parent()
    # a closed terminal signals the whole group, and the queue is needed to the end
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def _listen(queue: "Queue[tuple[str, int, int] | None]", on_progress: StudyProgress) -> None:
    while (report := queue.get()) is not None:
        on_progress(*report)
