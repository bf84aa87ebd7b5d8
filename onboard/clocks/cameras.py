"""Cameras and radars that stamp by the autopilot's clock, but do not follow when it jumps."""

from typing import Final

from onboard.messages import Exposure, Message
from onboard.units import NS_PER_S

MOST: Final = 32  # sources that are known
JUMPS: Final = 3  # of the autopilot's clock, that a source may not have followed
ALIKE_NS: Final = 150_000_000  # by which a source's latency varies
UNLIKE_NS: Final = 2 * NS_PER_S  # so long another latency: it is the usual one now

Source = tuple[type[Message], str]


class Followers:
    """By source, how late its messages arrive. Once the autopilot's clock has jumped, a source's stamps may be of
    the clock as it was: of the two times, that one holds whose latency is most like the last one's."""

    def __init__(self) -> None:
        self._latency_ns: dict[Source, int] = {}
        self._unlike_since: dict[Source, int] = {}  # arrival since which the latency is another
        self._before: list[int] = []  # host - boot, as it was before each of the last jumps

    def jump(self, offset_ns: int) -> None:
        """The autopilot's clock has jumped; the offset was this before."""
        self._before = [*self._before, offset_ns][-JUMPS:]

    def stamp(self, message: Message, t_ns: int, offset_ns: int) -> int:
        """The time of a message on the boot clock as it is now, at this offset, for a stamp of then or of now."""
        source = type(message), message.camera if isinstance(message, Exposure) else ""
        times = [t_ns, *(t_ns + before - offset_ns for before in self._before)]
        usual = self._latency_ns.get(source)
        arrived = message.t_recv_ns - offset_ns
        found = t_ns if usual is None else min(times, key=lambda t: abs(arrived - t - usual))
        if usual is not None or len(self._latency_ns) < MOST:
            self._learn(source, arrived - found, message.t_recv_ns)
        return found

    def _learn(self, source: Source, latency_ns: int, t_recv: int) -> None:
        """Until a jump of the autopilot's clock is certain, stamps of a source that follows look late or early:
        that is not its usual latency."""
        is_like = abs(latency_ns - self._latency_ns.get(source, latency_ns)) < ALIKE_NS
        if is_like or t_recv - self._unlike_since.setdefault(source, t_recv) > UNLIKE_NS:
            self._latency_ns[source] = latency_ns
            self._unlike_since.pop(source, None)
