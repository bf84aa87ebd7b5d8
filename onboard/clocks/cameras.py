"""Cameras and radars that stamp with the autopilot's clock but do not follow its jumps."""

from typing import Final

from onboard.messages import Exposure, Message
from onboard.units import NS_PER_S

MOST_SOURCES: Final = 32  # sources that are known to follow
JUMPS: Final = 3  # of the autopilot's clock that a source may have missed
EARLY_NS: Final = 5_000_000  # jitter by which a stamp may be later than its arrival
MAX_LATENCY_NS: Final = NS_PER_S // 2  # of a useful image: `rewind_horizon_s`; most jumps are longer

Source = tuple[type[Message], str]


class Followers:
    """After a jump of the autopilot's clock, a source's stamps may still be of an earlier clock. The present clock
    wins wherever it is plausible, and for good: nothing is learnt from a choice."""

    def __init__(self) -> None:
        self._following: set[Source] = set()
        self._before: list[int] = []  # host - boot before each of the last jumps, the last first

    def jump(self, offset_ns: int) -> None:
        """The autopilot's clock has jumped from this offset."""
        self._before = [offset_ns, *self._before][:JUMPS]
        self._following.clear()

    def stamp(self, message: Message, t_ns: int, offset_ns: int) -> int:
        """The time of a message on the present boot clock, at this offset, for a stamp of an earlier or the
        present clock."""
        arrived = message.t_recv_ns - offset_ns
        source = type(message), message.camera if isinstance(message, Exposure) else ""
        if -EARLY_NS <= arrived - t_ns < MAX_LATENCY_NS and len(self._following) < MOST_SOURCES:
            self._following.add(source)
        if source in self._following:
            return t_ns
        earlier = (t_ns + before - offset_ns for before in self._before)
        return next((t for t in earlier if -EARLY_NS <= arrived - t < MAX_LATENCY_NS), t_ns)
