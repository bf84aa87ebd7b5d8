"""Classification of stamps that do not fit: a jump of the clock, or repetition."""

from collections import deque
from typing import Final

from msgspec.structs import replace

from onboard.messages import Message
from onboard.units import NS_PER_S

CONFIRMING_STAMP_COUNT: Final = 5
MAX_OFFSET_SPREAD_NS: Final = NS_PER_S  # of arrival minus stamp on one clock
MAX_REPEAT_AGE_NS: Final = 10 * NS_PER_S  # latest repetition by a second link
REMEMBERED_STAMP_COUNT: Final = 10_000  # messages, to recognise repetitions
MIN_ALONE_DURATION_NS: Final = NS_PER_S  # If only old stamps arrive for this long, no link repeats them.
MIN_BACKWARD_DURATION_NS: Final = 250_000_000  # If only older stamps arrive for this long, the clock was set back.


class OddStamps:
    """Stamps since the last one that fitted.

    After a reboot, earlier stamps never return. A second link or a router repeats the past, late and in bulk,
    while the first link continues."""

    def __init__(self) -> None:
        self._odd: list[tuple[int, int]] = []  # (t_recv, offset) of stamps that agree
        self._back: list[int] = []  # arrivals of stamps behind the newest
        self._newest_stamp = 0
        self._received: deque[int] = deque()  # hashes of the last messages
        self._known: set[int] = set()  # the same

    @property
    def is_pending(self) -> bool:
        """Whether stamps that do not fit agree: perhaps the clock has jumped."""
        return bool(self._odd or self._back)

    def fit(self, newest_stamp: int) -> None:
        """Forget odd stamps after a stamp that fits."""
        self._newest_stamp = newest_stamp
        self._odd.clear()
        self._back.clear()

    def repeats(self, message: Message) -> bool:
        """Whether an identical message was received before."""
        key = hash(replace(message, t_recv_ns=0))
        if key in self._known:
            return True
        self._known.add(key)
        self._received.append(key)
        if len(self._received) > REMEMBERED_STAMP_COUNT:
            self._known.discard(self._received.popleft())
        return False

    def confirm(self, t_recv: int, stamp: int, base_ns: int, is_repeated: bool) -> bool:
        """Whether enough other odd stamps agree with this one.

        Stamps that a link may repeat must have come alone for a while. `base_ns`: arrival minus stamp of stamps
        that fit."""
        if is_repeated:
            self._odd.clear()
            return False
        offset = t_recv - stamp
        self._odd = [o for o in self._odd if abs(o[1] - offset) < MAX_OFFSET_SPREAD_NS]
        self._odd = [*self._odd[: CONFIRMING_STAMP_COUNT - 1], (t_recv, offset)]
        is_alone = t_recv - self._odd[0][0] >= MIN_ALONE_DURATION_NS
        return len(self._odd) == CONFIRMING_STAMP_COUNT and (
            is_alone or not self.may_repeat(stamp, offset - base_ns)
        )

    def may_repeat(self, stamp: int, late_ns: int) -> bool:
        """Whether a stamp this late may be of the same clock's recent past."""
        return 0 < late_ns <= MAX_REPEAT_AGE_NS and stamp <= self._newest_stamp

    def stays_back(self, t_recv: int) -> bool:
        """Whether, with this one, all stamps have been behind the newest for a while."""
        self._back = [*self._back[: CONFIRMING_STAMP_COUNT - 1], t_recv]
        return len(self._back) == CONFIRMING_STAMP_COUNT and t_recv - self._back[0] >= MIN_BACKWARD_DURATION_NS
