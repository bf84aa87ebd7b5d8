"""Datagrams -> messages, by their encoding; bad ones are counted by reason, and nothing is raised."""

from collections import Counter
from collections.abc import Callable
from typing import Final

from onboard.messages import Datagram, Encoding, Message
from onboard.wire.document import BadDocumentError
from onboard.wire.mavlink_decode import MavlinkDecoder, OnError, raise_error
from onboard.wire.points import decode_points
from onboard.wire.radar import decode_radar
from onboard.wire.ranges import decode_ranges

DOCUMENTS: Final[dict[Encoding, Callable[[bytes, int], Message]]] = {
    Encoding.POINTS: decode_points,
    Encoding.RADAR: decode_radar,
    Encoding.RANGES: decode_ranges,
}
OnRefused = Callable[[str, str, int], None]


def ignore(_source: str, _reason: str, _t_recv_ns: int) -> None:
    """What cannot be used is only counted."""


class DatagramDecoder:
    """One MAVLink decoder for each channel; JSON documents need no state. `on_error` is called with the
    place and the exception over one frame or document, `on_refused` with the channel, the reason and the arrival
    of a document that cannot be used."""

    def __init__(self, on_error: OnError = raise_error, on_refused: OnRefused = ignore) -> None:
        self._on_error = on_error
        self._on_refused = on_refused
        self._mavlink: dict[str, MavlinkDecoder] = {}
        self._bad: Counter[str] = Counter()

    def decode(self, datagram: Datagram) -> list[Message]:
        """The messages in one datagram, in SI units."""
        decode_document = DOCUMENTS.get(datagram.encoding)
        if decode_document is not None:
            try:
                return [decode_document(datagram.data, datagram.t_recv_ns)]
            except BadDocumentError as error:
                self._bad[f"bad_{datagram.encoding}"] += 1
                self._on_refused(datagram.channel, str(error), datagram.t_recv_ns)
                return []
            except Exception as error:  # of any kind: it costs this document
                self._on_error(f"bad_{datagram.encoding}", error)
                return []
        decoder = self._mavlink.get(datagram.channel)
        if decoder is None:
            decoder = MavlinkDecoder(stream=datagram.encoding is Encoding.MAVLINK_STREAM, on_error=self._on_error)
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
