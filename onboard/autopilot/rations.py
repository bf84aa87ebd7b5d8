"""Rate limit of answers to each system, in bytes.

An answer may be a hundred times as long as its request, and costs time that estimates need. A ration bounds both.
"""

from typing import Final

from onboard.messages import Message
from onboard.units import NS_PER_S

MAX_BYTES: Final = 8192  # to one source at once: two lists of parameters
BYTES_PER_S: Final = 4096  # less than a serial line at 57,600 Bd carries
STORAGE_BYTES: Final = 400  # cost of setting a parameter, which is checked and stored
MAX_SOURCE_COUNT: Final = 16  # all others share one ration
Source = tuple[int, int]
OTHER_SOURCES: Final[Source] = (-1, -1)


class Rations:
    """Bytes that each source may still be sent. A source with a full ration is forgotten."""

    def __init__(self) -> None:
        self._remaining: dict[Source, tuple[float, int]] = {}  # bytes, at a time

    def admits(self, message: Message, now_ns: int) -> bool:
        """Whether a message may be answered now."""
        return self._remaining_bytes(self._source(message, now_ns), now_ns) > 0.0

    def spend(self, message: Message, size: int, now_ns: int) -> None:
        """Subtract an answer of `size` bytes; the remainder may become negative."""
        source = self._source(message, now_ns)
        self._remaining[source] = self._remaining_bytes(source, now_ns) - size, now_ns

    def _source(self, message: Message, now_ns: int) -> Source:
        source = message.system, message.component
        if source not in self._remaining and len(self._remaining) >= MAX_SOURCE_COUNT:
            kept = {
                s: remaining
                for s, remaining in self._remaining.items()
                if self._remaining_bytes(s, now_ns) < MAX_BYTES
            }
            self._remaining = kept
            if len(kept) >= MAX_SOURCE_COUNT:
                return OTHER_SOURCES
        return source

    def _remaining_bytes(self, source: Source, now_ns: int) -> float:
        remaining, since_ns = self._remaining.get(source, (MAX_BYTES, now_ns))
        return min(remaining + max(now_ns - since_ns, 0) * BYTES_PER_S / NS_PER_S, MAX_BYTES)
