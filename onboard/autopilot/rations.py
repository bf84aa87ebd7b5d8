"""How much each system may have us answer. An answer may be a hundred times as long as what asks for it, and costs
time that estimates need; a ration bounds both, whoever asks and however often."""

from typing import Final

from onboard.messages import Message
from onboard.units import NS_PER_S

MOST_BYTES: Final = 8192  # of answers to one source at once: two lists of parameters
BYTES_PER_S: Final = 4096  # then; less than a serial line at 57,600 Bd carries
STORED: Final = 400  # bytes that a parameter counts for that is set: it is checked and stored
SOURCES: Final = 16  # with a ration of their own; all others share one
Source = tuple[int, int]
OTHER_SOURCES: Final[Source] = (-1, -1)


class Rations:
    """What is left to each source, bytes. One whose ration is whole again is forgotten."""

    def __init__(self) -> None:
        self._left: dict[Source, tuple[float, int]] = {}  # as of a time

    def admits(self, message: Message, now_ns: int) -> bool:
        """Whether a message may be answered now."""
        return self._of(self._source(message, now_ns), now_ns) > 0.0

    def spend(self, message: Message, size: int, now_ns: int) -> None:
        """Count an answer of that many bytes, which may be more than is left: less than one burst."""
        source = self._source(message, now_ns)
        self._left[source] = self._of(source, now_ns) - size, now_ns

    def _source(self, message: Message, now_ns: int) -> Source:
        source = message.system, message.component
        if source not in self._left and len(self._left) >= SOURCES:
            kept = {s: left for s, left in self._left.items() if self._of(s, now_ns) < MOST_BYTES}
            self._left = kept
            if len(kept) >= SOURCES:
                return OTHER_SOURCES
        return source

    def _of(self, source: Source, now_ns: int) -> float:
        left, since_ns = self._left.get(source, (MOST_BYTES, now_ns))
        return min(left + max(now_ns - since_ns, 0) * BYTES_PER_S / NS_PER_S, MOST_BYTES)
