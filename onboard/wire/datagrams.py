"""Datagrams -> messages, by their encoding; bad ones are counted by reason."""

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from onboard.messages import Datagram, Encoding, Exposure, Message
from onboard.messages.causes import Cause, Reason
from onboard.wire.documents.cameras import Cameras, find
from onboard.wire.documents.detections import decode_detections
from onboard.wire.documents.document import BadDocumentError, Refuse
from onboard.wire.documents.points import decode_points
from onboard.wire.documents.pseudoranges import decode_ranges
from onboard.wire.documents.radar import decode_radar
from onboard.wire.documents.warm_state import decode_warm_state
from onboard.wire.logs import tlog
from onboard.wire.mavlink.decode import IsOwn, MavlinkDecoder, OnError, is_never_own, raise_error
from onboard.wire.mavlink.signing import Stamps, Verifier
from onboard.wire.mavlink.tracking import TrackerDecoder
from onboard.wire.ros.topics import RosDecoder

DOCUMENTS: Final[dict[Encoding, Callable[[bytes, int, Refuse], Message]]] = {
    Encoding.POINTS: lambda data, t_recv_ns, _: decode_points(data, t_recv_ns),
    Encoding.RADAR: decode_radar,
    Encoding.RANGES: decode_ranges,
    Encoding.WARM_STATE: lambda data, t_recv_ns, _: decode_warm_state(data, t_recv_ns),
}
NO_CAMERAS: Final[Cameras] = {}
Keys = Mapping[str, bytes | None]  # by channel; None: not at hand
NO_KEYS: Final[Keys] = {}
MAX_IGNORED_COUNT: Final = 64  # unknown fields and points that are reported, each once
MIN_FRAMELESS_COUNT: Final = 10  # pieces; a connection may begin in the middle of a frame
MAX_IGNORED_LENGTH: Final = 200  # characters
NO_FRAME: Final = Reason(Cause.BAUD_RATE, "no MAVLink frame is in what arrives; of a serial port: the baud rate?")
JSON_ON_MAVLINK: Final = Reason(
    Cause.NO_MAVLINK, "no MAVLink frame is in what arrives; it looks like JSON, which a `json:` link takes"
)
OUR_FRAMES: Final = (
    "this is us: our frames come back on link `{}`, by a router or by somebody who repeats them, or another "
    "program has our ids; give it other ones"
)
OnRefused = Callable[[str, Reason, int], None]


def ignore(_source: str, _why: Reason, _t_recv_ns: int) -> None:
    """Count a refused datagram only."""


class DatagramDecoder:
    """Decoders of all encodings, with one MAVLink decoder for each channel.

    `on_error` receives the place and the exception over one frame or document, `on_refused` the channel, reason
    and arrival of an unusable document. `keys` holds the channels whose frames must be signed. `is_own` recognises
    our own frames.
    """

    def __init__(
        self,
        on_error: OnError = raise_error,
        on_refused: OnRefused = ignore,
        cameras: Cameras = NO_CAMERAS,
        keys: Keys = NO_KEYS,
        is_own: IsOwn = is_never_own,
    ) -> None:
        self._on_error = on_error
        self._on_refused = on_refused
        self._cameras = cameras
        self._keys, self._is_own, self._ros = keys, is_own, RosDecoder(cameras)
        self._stamps: dict[bytes, Stamps] = {}  # of signed frames, by key: its links share them
        self._mavlink: dict[str, MavlinkDecoder] = {}
        self._repetitions: dict[bytes, int] = {}
        self._bad: Counter[str] = Counter()
        self._ignored: set[str] = set()
        self._foreign: Counter[str] = Counter()  # pieces by channel, before its first frame

    def decode(self, datagram: Datagram) -> list[Message]:
        """The messages in one datagram, in SI units."""
        if datagram.encoding in (Encoding.MAVLINK, Encoding.MAVLINK_STREAM):
            step_ns = datagram.wall_step_ns or 0
            decoder = self._decoder(datagram)
            messages = decoder.decode(datagram.data, datagram.t_recv_ns, step_ns)
            if not decoder.names and decoder.rejected["bad_frame"]:
                self._report_no_frame(datagram)
            return messages
        try:
            return self._document(datagram)
        except BadDocumentError as error:
            self._refuse(datagram, error.why)
        except Exception as error:  # of any kind: it costs this document
            self._on_error(f"bad_{datagram.encoding}", error)
        return []

    def _decoder(self, datagram: Datagram) -> MavlinkDecoder:
        decoder = self._mavlink.get(datagram.channel)
        if decoder is None:
            decoder = MavlinkDecoder(
                stream=datagram.encoding is Encoding.MAVLINK_STREAM,
                on_error=self._on_error,
                verifier=self._verifier(datagram.channel),
                repetitions=self._repetitions,
                trackers=TrackerDecoder(self._cameras, partial(self._refuse_tracker, datagram.channel)),
                is_own=self._is_own,
                on_own=partial(self._name_own, datagram.channel),
            )
            self._mavlink[datagram.channel] = decoder
        return decoder

    def _verifier(self, channel: str) -> Verifier | None:
        """The verifier of a channel whose frames must be signed."""
        if channel not in self._keys:
            return None
        key, on_refused = self._keys.get(channel), partial(self._on_refused, channel)
        stamps = {} if key is None else self._stamps.setdefault(key, {})
        return Verifier(key, on_refused, stamps)

    def _name_own(self, channel: str, system: int, component: int, t_recv_ns: int) -> None:
        """Say that frames of ours came back; a ground station's log has them in any case."""
        if channel != tlog.TLOG_CHANNEL:
            why = Reason(Cause.OURSELVES, OUR_FRAMES.format(channel))
            self._on_refused(f"system {system}, component {component}", why, t_recv_ns)

    def _report_no_frame(self, datagram: Datagram) -> None:
        """Report a channel whose bytes have contained no frame for a while, with a likely cause."""
        self._foreign[datagram.channel] += 1
        if self._foreign[datagram.channel] >= MIN_FRAMELESS_COUNT:
            is_json = datagram.data.lstrip()[:1] in (b"{", b"[")
            self._on_refused(datagram.channel, JSON_ON_MAVLINK if is_json else NO_FRAME, datagram.t_recv_ns)

    def _document(self, datagram: Datagram) -> list[Message]:
        """The messages of one document. Raises BadDocumentError."""
        data, t_recv_ns = datagram.data, datagram.t_recv_ns
        refuse, ignored = partial(self._refuse, datagram), partial(self._ignore, datagram)
        if datagram.encoding is Encoding.ROS:
            return [*self._ros.decode(datagram, refuse, ignored)]
        if datagram.encoding is not Encoding.DETECTIONS:
            message = DOCUMENTS[datagram.encoding](data, t_recv_ns, refuse)
            if isinstance(message, Exposure) and self._cameras:
                find(self._cameras, message.camera)
            return [message]
        found = decode_detections(data, t_recv_ns, self._cameras, refuse, ignored)
        return [found] if found else []

    def _refuse(self, datagram: Datagram, why: Reason) -> None:
        self._bad[f"bad_{datagram.encoding}"] += 1
        self._on_refused(datagram.channel, why, datagram.t_recv_ns)

    def _refuse_tracker(self, channel: str, why: Reason, t_recv_ns: int) -> None:
        self._bad["bad_tracking"] += 1
        self._on_refused(channel, why, t_recv_ns)

    def _ignore(self, datagram: Datagram, what: str) -> None:
        """Name what is ignored once: detectors send much that is of no use here."""
        what = what[:MAX_IGNORED_LENGTH]
        if what in self._ignored or len(self._ignored) >= MAX_IGNORED_COUNT:
            return
        self._ignored.add(what)
        self._bad["ignored_fields"] += 1
        ignored = Reason(Cause.IGNORED, f"(the rest is used) {what}")
        self._on_refused(datagram.channel, ignored, datagram.t_recv_ns)

    @property
    def frames(self) -> Counter[str]:
        """Counts of well-formed MAVLink frames by name."""
        total: Counter[str] = Counter()
        for decoder in self._mavlink.values():
            total.update(decoder.names)
        return total

    @property
    def unverified(self) -> dict[str, int]:
        """Counts by channel of signed frames that passed because their key is unavailable."""
        return {channel: decoder.unverified for channel, decoder in self._mavlink.items() if decoder.unverified}

    @property
    def rejected(self) -> Counter[str]:
        """Counts of rejected frames and documents by reason."""
        total = Counter(self._bad)
        for decoder in self._mavlink.values():
            total.update(decoder.rejected)
        return total
