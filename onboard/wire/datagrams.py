"""Datagrams -> messages, by their encoding; bad ones are counted by reason, and nothing is raised."""

from collections import Counter
from collections.abc import Callable
from typing import Final, NamedTuple

from onboard.messages import Datagram, Encoding, Message
from onboard.wire.mavlink_decode import MavlinkDecoder
from onboard.wire.points import BadPointsError, decode_points
from onboard.wire.radar import BadRadarError, decode_radar
from onboard.wire.ranges import BadRangesError, decode_ranges


class Document(NamedTuple):
    """How a datagram that holds one JSON document becomes a message, and what it raises and counts otherwise."""

    decode: Callable[[bytes, int], Message]
    error: type[Exception]
    reason: str


DOCUMENTS: Final = {
    Encoding.POINTS: Document(decode_points, BadPointsError, "bad_points"),
    Encoding.RADAR: Document(decode_radar, BadRadarError, "bad_radar"),
    Encoding.RANGES: Document(decode_ranges, BadRangesError, "bad_ranges"),
}


class DatagramDecoder:
    """One MAVLink decoder for each channel; JSON documents need no state."""

    def __init__(self) -> None:
        self._mavlink: dict[str, MavlinkDecoder] = {}
        self._bad: Counter[str] = Counter()

    def decode(self, datagram: Datagram) -> list[Message]:
        """The messages in one datagram, in SI units."""
        document = DOCUMENTS.get(datagram.encoding)
        if document is not None:
            try:
                return [document.decode(datagram.data, datagram.t_recv_ns)]
            except document.error:
                self._bad[document.reason] += 1
                return []
        decoder = self._mavlink.get(datagram.channel)
        if decoder is None:
            decoder = MavlinkDecoder(stream=datagram.encoding is Encoding.MAVLINK_STREAM)
            self._mavlink[datagram.channel] = decoder
        return decoder.decode(datagram.data, datagram.t_recv_ns)

    @property
    def frames(self) -> Counter[str]:
        """Well-formed MAVLink frames so far, by name."""
        total: Counter[str] = Counter()
        for decoder in self._mavlink.values():
            total.update(decoder.names)
        return total

    @property
    def rejected(self) -> Counter[str]:
        """What could not be decoded so far, by reason."""
        total = Counter(self._bad)
        for decoder in self._mavlink.values():
            total.update(decoder.rejected)
        return total
