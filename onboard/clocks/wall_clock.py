"""Stamps of this computer's wall clock, converted to the clock of arrivals."""

from typing import Final

from onboard.messages import Message
from onboard.units import NS_PER_S

STEP_OVERLAP_DURATION_NS: Final = 2 * NS_PER_S  # Stamps from before a step of the wall clock may arrive this late.


class WallClock:
    """Steps of the wall clock."""

    def __init__(self) -> None:
        self.is_even = False  # The clock of arrivals is never set.
        self._steps: list[tuple[int, int]] = []  # (since which arrival, wall clock - arrivals' clock)
        self._latency_ns: dict[type[Message], int] = {}  # of the last message that this computer stamped

    def compare(self, t_recv_ns: int, step_ns: int | None) -> bool:
        """Store the wall clock's offset, None if it stamps arrivals; return whether it was set."""
        if step_ns is None:
            return False
        self.is_even = True
        if self._steps and self._steps[-1][1] == step_ns:
            return False
        was_set = bool(self._steps)
        self._steps = [*self._steps[-1:], (t_recv_ns, step_ns)]
        return was_set

    def unset(self, message: Message) -> int:
        """Convert a stamp of the wall clock to the clock of arrivals.

        Soon after a step, a message may have been stamped before it. Of the two possible times, the one whose
        latency is closest to the last is used."""
        t_recv_ns, times = message.t_recv_ns, [message.t_ns]
        if self._steps:
            is_recent = t_recv_ns - self._steps[-1][0] < STEP_OVERLAP_DURATION_NS
            times = [message.t_ns - step for _, step in self._steps[-2 if is_recent else -1 :]]
        usual_ns = self._latency_ns.get(type(message))
        t_ns = times[-1] if usual_ns is None else min(times, key=lambda t: abs(t_recv_ns - t - usual_ns))
        self._latency_ns[type(message)] = t_recv_ns - t_ns
        return t_ns
