"""All studies, two at a time, each with half of the cores: while one draws its figures, the other goes on."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any, Final

import msgspec

from onboard import studies
from onboard.studies.report.workers import Progress

AT_ONCE: Final = 2
# what takes longest goes first, so that the last ones are short; measured
LONGEST: Final = (
    *("relative-motion", "csvsf-quadrotor", "traffic", "own-state"),
    *("joseph-srukf-sense-and-avoid", "ukf-radar-launch-vehicle"),
)

Told = Callable[[str, int, int], None]
Said = tuple[str, int, int] | None


def run_study(
    name: str, seeds: int | None, out: Path, progress: Progress, jobs: int | None = None
) -> dict[str, Any]:
    """One study, by its name, in `jobs` processes (None: one per core); its files go to a folder of `out`. Its
    numbers as plain values.

    Raises ImportError where figures cannot be drawn.
    """
    module = import_module(f"{studies.__name__}.{name.replace('-', '_')}.study")
    asked = {} if seeds is None else {"seeds": seeds}
    numbers: dict[str, Any] = msgspec.to_builtins(
        module.run(**asked, jobs=jobs, out=out / name, progress=progress)
    )
    return numbers


def run_all(names: Sequence[str], seeds: int | None, out: Path, told: Told) -> dict[str, dict[str, Any]]:
    """Every study of these names, in their order. `told(name, done, total)` is called, from a thread, as parts of
    them finish. Raises what a study does; those not begun then never are."""
    context = get_context("spawn")
    order = sorted(names, key=lambda name: LONGEST.index(name) if name in LONGEST else len(LONGEST))
    found: dict[str, dict[str, Any]] = {}
    with context.Manager() as manager, ProcessPoolExecutor(AT_ONCE, context) as pool:
        queue: Queue[Said] = manager.Queue()
        listener = Thread(target=_listen, args=(queue, told), daemon=True)
        listener.start()
        running = {pool.submit(_child, queue, name, seeds, out): name for name in order}
        try:
            for done in as_completed(running):
                found[running[done]] = done.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            queue.put(None)
            listener.join()
    return {name: found[name] for name in names}


def _child(queue: "Queue[Said]", name: str, seeds: int | None, out: Path) -> dict[str, Any]:
    jobs = max(1, (os.cpu_count() or 1) // AT_ONCE)  # with one, a study starts no process of its own
    return run_study(name, seeds, out, lambda done, total: queue.put((name, done, total)), jobs)


def _listen(queue: "Queue[Said]", told: Told) -> None:
    while (heard := queue.get()) is not None:
        told(*heard)
