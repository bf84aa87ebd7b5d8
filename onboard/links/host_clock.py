"""This computer's clock of arrivals and timers: Unix time at the start, and never set."""

import time
from collections.abc import Callable
from functools import partial
from typing import Final

SMALLEST_STEP_NS: Final = 1_000_000
MAX_READ_TIME_NS: Final = 100_000  # of both clocks; a longer reading was interrupted


def _since_boot() -> Callable[[], int]:
    """A clock that is never set and, if available, counts while the computer is suspended."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic_ns if clock is None else partial(time.clock_gettime_ns, clock)


class HostClock:
    """A clock that starts at Unix time and rises evenly.

    The wall clock may be set (by NTP, GPS or a person); `step_ns` is the sum of its steps since the start. Other
    processes stamp with the wall clock.
    """

    def __init__(
        self, *, wall: Callable[[], int] = time.time_ns, monotonic: Callable[[], int] | None = None
    ) -> None:
        self._wall, self._monotonic = wall, monotonic or _since_boot()
        self._begin_ns = wall() - self._monotonic()
        self._step_ns = 0

    def now_ns(self) -> int:
        """The time, ns."""
        return self._begin_ns + self._monotonic()

    def step_ns(self) -> int:
        """The wall clock's time less `now_ns`; steps below 1 ms are not noticed."""
        before = self._monotonic()
        wall = self._wall()
        after = self._monotonic()
        step_ns = wall - self._begin_ns - (before + after) // 2
        if after - before < MAX_READ_TIME_NS and abs(step_ns - self._step_ns) > SMALLEST_STEP_NS:
            self._step_ns = step_ns
        return self._step_ns
