"""Stamps of this computer's wall clock, converted to the clock of arrivals."""

from typing import Final

from onboard.messages import Message
from onboard.units import NS_PER_S

STEP_SEEN_NS: Final = 2 * NS_PER_S  # time for which stamps from before a step of the wall clock may arrive


class WallClock:
    """The steps of the wall clock. `is_even`: whether the clock of arrivals is never set."""

    def __init__(self) -> None:
        self.is_even = False
        self._steps: list[tuple[int, int]] = []  # (since which arrival, wall clock - arrivals' clock)
        self._latency_ns: dict[type[Message], int] = {}  # of the last message that this computer stamped

    def compare(self, t_recv_ns: int, step_ns: int | None) -> bool:
        """Learn its offset, None if arrivals are stamped by it. True if it was set just now."""
        if step_ns is None:
            return False
        self.is_even = True
        if self._steps and self._steps[-1][1] == step_ns:
            return False
        was_set = bool(self._steps)
        self._steps = [*self._steps[-1:], (t_recv_ns, step_ns)]
        return was_set

    def unset(self, message: Message) -> int:
        """A stamp of the wall clock on the clock of arrivals. Soon after a step, a message may have been stamped
        before it: of the two possible times, the one whose latency is closest to the last is used."""
        t_recv_ns, times = message.t_recv_ns, [message.t_ns]
        if self._steps:
            is_recent = t_recv_ns - self._steps[-1][0] < STEP_SEEN_NS
            times = [message.t_ns - step for _, step in self._steps[-2 if is_recent else -1 :]]
        usual_ns = self._latency_ns.get(type(message))
        t_ns = times[-1] if usual_ns is None else min(times, key=lambda t: abs(t_recv_ns - t - usual_ns))
        self._latency_ns[type(message)] = t_recv_ns - t_ns
        return t_ns
