"""Cameras and radars that stamp with the autopilot's clock but do not follow its jumps."""

from typing import Final

from onboard.messages import Exposure, Message
from onboard.units import NS_PER_S

MAX_SOURCE_COUNT: Final = 32  # bounds memory
MAX_MISSED_JUMP_COUNT: Final = 3  # jumps of the autopilot's clock that a source may have missed
STAMP_JITTER_TOLERANCE_NS: Final = 5_000_000  # Jitter can make a stamp this much later than its arrival.
MAX_LATENCY_NS: Final = NS_PER_S // 2  # of a useful image: `rewind_horizon_s`; most jumps are longer

Source = tuple[type[Message], str]


class Followers:
    """Sources that follow the autopilot's clock, and the offsets before its last jumps.

    After a jump a source's stamps may still be of an earlier clock. The present clock wins wherever it is
    plausible, and for good: nothing is learnt from a choice."""

    def __init__(self) -> None:
        self._following: set[Source] = set()
        self._before: list[int] = []  # host - boot before each of the last jumps, the last first

    def jump(self, offset_ns: int) -> None:
        """Store the offset before a jump of the autopilot's clock."""
        self._before = [offset_ns, *self._before][:MAX_MISSED_JUMP_COUNT]
        self._following.clear()

    def stamp(self, message: Message, t_ns: int, offset_ns: int) -> int:
        """Return the time of a message on the present boot clock.

        Its stamp is of the present or of an earlier clock."""
        arrived = message.t_recv_ns - offset_ns
        source = type(message), message.camera if isinstance(message, Exposure) else ""
        if (
            -STAMP_JITTER_TOLERANCE_NS <= arrived - t_ns < MAX_LATENCY_NS
            and len(self._following) < MAX_SOURCE_COUNT
        ):
            self._following.add(source)
        if source in self._following:
            return t_ns
        earlier = (t_ns + before - offset_ns for before in self._before)
        return next((t for t in earlier if -STAMP_JITTER_TOLERANCE_NS <= arrived - t < MAX_LATENCY_NS), t_ns)
