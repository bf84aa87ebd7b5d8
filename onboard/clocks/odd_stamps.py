"""Stamps that do not fit: has the autopilot's clock jumped, or does a link repeat the past?"""

from collections import deque
from typing import Final

from msgspec.structs import replace

from onboard.messages import Message
from onboard.units import NS_PER_S

STAMPS_TO_CONFIRM: Final = 5
AGREE_NS: Final = NS_PER_S  # spread of arrival minus stamp on one clock
REPEATED_NS: Final = 10 * NS_PER_S  # latest repetition by a second link
STAMPS_REMEMBERED: Final = 10_000  # messages, to recognise repetitions
ALONE_NS: Final = NS_PER_S  # after only old stamps for this long, no link repeats them
BACK_LASTS_NS: Final = 250_000_000  # after only older stamps for this long, the clock has jumped back


class OddStamps:
    """Stamps since the last one that fitted. After a reboot, earlier stamps never return; a second link or a
    router repeats the past, late and in bulk, while the first one continues."""

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
        """A stamp fits and is the newest."""
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
        if len(self._received) > STAMPS_REMEMBERED:
            self._known.discard(self._received.popleft())
        return False

    def confirm(self, t_recv: int, stamp: int, base_ns: int, is_repeated: bool) -> bool:
        """Whether enough other odd stamps agree with this one. Stamps that a link may repeat must have come alone
        for a while. `base_ns`: arrival minus stamp of those that fit."""
        if is_repeated:
            self._odd.clear()
            return False
        offset = t_recv - stamp
        self._odd = [o for o in self._odd if abs(o[1] - offset) < AGREE_NS]
        self._odd = [*self._odd[: STAMPS_TO_CONFIRM - 1], (t_recv, offset)]
        is_alone = t_recv - self._odd[0][0] >= ALONE_NS
        return len(self._odd) == STAMPS_TO_CONFIRM and (is_alone or not self.may_repeat(stamp, offset - base_ns))

    def may_repeat(self, stamp: int, late_ns: int) -> bool:
        """Whether a stamp this late may be of the same clock's recent past."""
        return 0 < late_ns <= REPEATED_NS and stamp <= self._newest_stamp

    def stays_back(self, t_recv: int) -> bool:
        """Whether, with this one, all stamps have been behind the newest for a while."""
        self._back = [*self._back[: STAMPS_TO_CONFIRM - 1], t_recv]
        return len(self._back) == STAMPS_TO_CONFIRM and t_recv - self._back[0] >= BACK_LASTS_NS
