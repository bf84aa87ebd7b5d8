"""A pool of processes, none of which outlives the program that started it."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext
from threading import Thread
from typing import Any, Final

CONTEXT: Final[SpawnContext] = multiprocessing.get_context("spawn")  # not forked: the caller may run threads


@contextmanager
def processes(
    count: int, initializer: Callable[..., object] | None = None, *arguments: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` processes that have all ended after the block.

    Each begins with `initializer(*arguments)`. They are stopped at once if the block raises, as on Ctrl-C."""
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(count, CONTEXT, initializer=_begin, initargs=(initializer, arguments)) as pool:
        try:
            yield pool
        except BaseException:
            for process in set(multiprocessing.active_children()) - others:  # else they end their parts first
                process.terminate()
            raise


def end_with_parent() -> None:
    """End this process when its parent has ended, even if that was killed."""
    Thread(target=_wait_for_end, daemon=True).start()


def _wait_for_end() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _begin(initializer: Callable[..., object] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started this one stops it
    end_with_parent()
    if initializer is not None:
        initializer(*arguments)
