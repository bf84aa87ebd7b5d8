"""Settings of the process for a flight.

Modules load without the garbage collector, which ignores them afterwards. Threads share a heap, and the daemon has
a higher priority than others."""

import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

M_ARENA_MAX: Final = -8
HEAPS: Final = 1
NICE: Final = -10


@contextmanager
def loading() -> Iterator[None]:
    """Whatever is made in this block is taken to stay until the process ends.

    The collector would run some three hundred times while the modules of a flight load, an eighth of that time; in
    flight it would go through all of them now and then, for as long as two images last; and again at the end.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


def share_heap() -> None:
    """Let all threads to come allocate from one heap. The GNU C library would give each of Zenoh's one of its own,
    some 4 MB more in all. Another C library may have none of this."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, HEAPS)


def go_first() -> None:
    """Let this thread, and those that it starts, go before others where processes wait for a core: an estimate
    that waits is late, and the whole daemon takes a fifth of a core. Only where nobody has chosen a priority for
    it, and where the system allows it: to root, or by `LimitNICE` of a service."""
    with suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) == 0:
            os.setpriority(os.PRIO_PROCESS, 0, NICE)
