"""The allowed cost of a test: seconds of a core on the computer that CONTRIBUTING names.

Computing time of the process is measured, not elapsed time. A yardstick, measured just after it, corrects for
another or a busy computer.
"""

import time
from collections.abc import Callable
from typing import Final

LIMIT_S: Final = 8.0  # of a core; longer tests are marked `slow`, next to a short test of the same
MAX_YARDSTICK_RATIO: Final = 1.6  # error of the yardstick on a busy computer, below which no test is refused
YARDSTICK_TIME_S: Final = 0.041  # of `_work` on that computer, the best of many


def computed() -> float:
    """Seconds of a core that this process has computed.

    Those of its processes would count for whichever test runs when they are reaped.
    """
    return time.process_time()


def yardstick() -> float:
    """Return the seconds of a core for a fixed piece of work, the worst of three.

    The computer may be busier than before.
    """
    return max(_work() for _ in range(3))


def too_much(seconds: float, measure: Callable[[], float] = yardstick) -> str | None:
    """Why a test that took these seconds of a core is refused; None if it is not."""
    if seconds <= MAX_YARDSTICK_RATIO * LIMIT_S:
        return None
    there = seconds * YARDSTICK_TIME_S / measure()
    if there <= MAX_YARDSTICK_RATIO * LIMIT_S:
        return None
    return f"{there:.1f} s of a core are more than {LIMIT_S:g}: shorten it, or mark it slow beside a short one"


def _work() -> float:
    begin, total, table = time.process_time(), 0.0, {}
    for k in range(300_000):
        total += (k * 0.5) % 3.0
        table[k & 255] = total
    return time.process_time() - begin
