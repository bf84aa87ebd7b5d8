"""What a test may cost: seconds of a core, in its own process, on the computer that CONTRIBUTING names.
Computing is measured, not the time that passes; a yardstick, measured just after it, makes up for another or a
busy computer."""

import time
from collections.abc import Callable
from typing import Final

LIMIT_S: Final = 8.0  # of a core; what takes more is marked `slow`, beside a short test of the same
ERRS: Final = 1.6  # times: so far the yardstick errs on a busy computer, and a test is refused only beyond that
YARDSTICK_S: Final = 0.041  # what `_work` took there, the best of many


def computed() -> float:
    """Seconds of a core that this process has computed. Those of its processes would count for whichever test runs
    when they are reaped."""
    return time.process_time()


def yardstick() -> float:
    """Seconds of a core for a fixed piece of work, the worst of three, as it may be busier than before."""
    return max(_work() for _ in range(3))


def too_much(seconds: float, measure: Callable[[], float] = yardstick) -> str | None:
    """Why a test that took these seconds of a core is refused; None if it is not."""
    if seconds <= ERRS * LIMIT_S:
        return None
    there = seconds * YARDSTICK_S / measure()
    if there <= ERRS * LIMIT_S:
        return None
    return f"{there:.1f} s of a core are more than {LIMIT_S:g}: shorten it, or mark it slow beside a short one"


def _work() -> float:
    begin, total, table = time.process_time(), 0.0, {}
    for k in range(300_000):
        total += (k * 0.5) % 3.0
        table[k & 255] = total
    return time.process_time() - begin
