"""Unix time at the start of a log, from the times of its GPS fixes.

Satellites send a week's number in 10 bits, so a receiver's time may be a multiple of 1,024 weeks early.
"""

from collections.abc import Callable, Iterable
from itertools import islice
from statistics import median_low
from typing import Final

DAY_LENGTH_US: Final = 86_400_000_000
ROLLOVER_US: Final = 1024 * 7 * DAY_LENGTH_US
GPS_EPOCH_US: Final = 315_964_800_000_000  # 6 January 1980, Unix time; an earlier clock was never set
MIN_FLIGHT_TIME_US: Final = 1_325_376_000_000_000  # 1 January 2012, before any log that is read
MAX_FIX_COUNT: Final = 1000
ROLLOVER: Final = "GPS: its time is 1,024 weeks early, a rollover of the receiver's weeks; it is corrected"


def corrected(t_us: int) -> int:
    """Return the first time from `MIN_FLIGHT_TIME_US` on that is whole rollovers later."""
    return t_us + max(-((t_us - MIN_FLIGHT_TIME_US) // ROLLOVER_US), 0) * ROLLOVER_US


def boot_time_ns(fixes: Iterable[tuple[int, int]], lose: Callable[[str], None]) -> int:
    """Return the Unix time at boot, ns, as the median over fixes; 0 without one.

    A fix has its Unix time and its time since boot, us; the first ones may have another week. `lose` receives the
    reason for a correction."""
    used = list(islice((fix for fix in fixes if fix[0] > GPS_EPOCH_US), MAX_FIX_COUNT))
    if 2 * sum(corrected(unix) != unix for unix, _ in used) > len(used):
        lose(ROLLOVER)
    return 1000 * median_low([corrected(unix) - boot for unix, boot in used]) if used else 0
