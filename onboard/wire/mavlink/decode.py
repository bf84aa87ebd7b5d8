"""MAVLink bytes -> records in SI units. Bad bytes are counted and never raise.

Each UDP datagram stands alone, so a truncated one cannot consume the next. In streams (TCP, serial) an incomplete
frame waits for its rest. After a bad checksum the search continues at the next byte, because the length may be
wrong. Every checksum is tested, but only payloads that become records are read. Signatures are tested where there
is a key and skipped elsewhere.
"""

import re
from binascii import crc_hqx
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final

from onboard.messages import Message
from onboard.wire.mavlink.frame import MESSAGES, MIRRORED, SIGNED, V1, V2, frame_length, parse_header
from onboard.wire.mavlink.landing_target import LANDING_TARGET, PointAssembler, is_point
from onboard.wire.mavlink.records import CONVERT, Convert, Layout
from onboard.wire.mavlink.signing import Verifier
from onboard.wire.mavlink.tracking import TrackerDecoder

START: Final = re.compile(b"[\xfd\xfe]")
MESSAGE_NAMES: Final = {number: (name, bytes([MIRRORED[extra]])) for number, (name, extra) in MESSAGES.items()}
UNKNOWN: Final = "unknown_message"
TRACKING: Final = Layout("<7f4B")  # CAMERA_TRACKING_IMAGE_STATUS
FIELD_OF_VIEW: Final = Layout("<I6i6f")  # CAMERA_FOV_STATUS, whose time is of the camera's own clock
REPEAT_WINDOW_NS: Final = 500_000_000  # two paths of one link, through a router and a bridge, differ by less
MAX_RECENT_FRAMES: Final = 128  # sequence numbers wrap after 256
OnError = Callable[[str, Exception], None]
IsOwn = Callable[[int, int, str], bool]  # system, component, name
OnOwn = Callable[[int, int, int], None]  # system, component, arrival


def raise_error(_place: str, error: Exception) -> None:
    """Raise an exception over one frame, where nobody counts it."""
    raise error


def is_never_own(_system: int, _component: int, _name: str) -> bool:
    """Nothing is sent, so nothing comes back."""
    return False


class MavlinkDecoder:
    """Decoder of one channel, with counts of frames by name and of rejections by reason.

    `on_error` receives the frame's name and the exception that it caused. Frames that `is_own` recognises are
    reported to `on_own` and refused before their signature is tested. With a `verifier`, only verified frames
    pass. `repetitions` maps recent frames of all redundant channels to their arrivals, oldest first; repeated
    frames are dropped. `trackers` decodes whole aircraft. `also` extends `CONVERT`.
    """

    def __init__(
        self,
        *,
        stream: bool,
        on_error: OnError = raise_error,
        verifier: Verifier | None = None,
        repetitions: dict[bytes, int] | None = None,
        trackers: TrackerDecoder | None = None,
        also: Mapping[str, tuple[Layout, Convert]] | None = None,
        is_own: IsOwn = is_never_own,
        on_own: OnOwn = lambda _system, _component, _t_recv_ns: None,
    ) -> None:
        self.rejected: Counter[str] = Counter()
        self.names: Counter[str] = Counter()
        self._stream = stream
        self._on_error = on_error
        self._verifier = verifier
        self._repetitions = repetitions
        self._untested = 0
        self._is_own, self._on_own = is_own, on_own
        self._rest = b""  # of a stream: the frame that is not complete yet
        self._is_lost = False  # within a stretch of bytes that are no frames
        self._points = PointAssembler(self.rejected)
        self._trackers = trackers or TrackerDecoder({})
        self._convert = CONVERT if also is None else {**CONVERT, **also}
        self._wall_step_ns = 0

    def decode(self, data: bytes, t_recv_ns: int, wall_step_ns: int = 0) -> list[Message]:
        """Decode the messages in `data`, in order.

        `t_recv_ns` is the arrival of the bytes. `wall_step_ns` is the sum of the later steps of the wall clock,
        which stamps signatures.
        """
        self._wall_step_ns = wall_step_ns
        data = self._rest + data
        messages: list[Message] = []
        at = 0
        self._is_lost = self._is_lost and self._stream
        while at < len(data):
            if data[at] not in (V1, V2):
                start = START.search(data, at)
                at = len(data) if start is None else start.start()
                self._lose("bad_frame")
                continue
            end = at + (frame_length(data, at) or len(data) + 1)  # a head that is cut off: more than there is
            if end > len(data) and self._stream:
                break
            frame = data[at:end]
            reason = "truncated" if end > len(data) else frame_error(frame)
            if reason == UNKNOWN and end == len(data) and self._stream:
                break  # the byte behind it says whether it is a frame
            if reason == UNKNOWN and (end == len(data) or data[end] in (V1, V2)):
                self.rejected[UNKNOWN] += 1  # no false start in noise: another frame follows
            elif reason:
                self._lose(reason)
                at += 1  # a length that is not confirmed by a checksum may be wrong, too
                continue
            else:
                message = self._message(frame, t_recv_ns)
                if message is not None:
                    messages.append(message)
            self._is_lost = False
            at = end
        if self._stream:
            self._rest = data[at:]
        return messages

    @property
    def unverified(self) -> int:
        """Signed frames that passed since their key is not at hand."""
        return self._untested if self._verifier is None else self._verifier.unverified

    def _lose(self, reason: str) -> None:
        """Count a stretch of bytes that are no frame, once, by what was wrong first."""
        if not self._is_lost:
            self.rejected[reason] += 1
        self._is_lost = True

    def _message(self, frame: bytes, t_recv_ns: int) -> Message | None:
        """The record of one sound frame, None if it has none."""
        head, number, system, component = parse_header(frame)
        name, payload = MESSAGE_NAMES[number][0], frame[head : head + frame[1]]
        if self._is_own(system, component, name) and not (name == "LANDING_TARGET" and is_point(payload)):
            self.rejected["our_own"] += 1
            self._on_own(system, component, t_recv_ns)
            return None
        if self._verifier is None:
            self._untested += frame[0] == V2 and frame[2] & SIGNED
        elif reason := self._verifier.check(frame, t_recv_ns, self._wall_step_ns):
            self.rejected[reason] += 1
            return None
        self.names[name] += 1
        if (recent := self._repetitions) is not None:
            before_ns = recent.pop(frame, None)
            recent[frame] = t_recv_ns
            if len(recent) > MAX_RECENT_FRAMES:
                del recent[next(iter(recent))]
            if before_ns is not None and abs(t_recv_ns - before_ns) <= REPEAT_WINDOW_NS:
                self.rejected["repeated"] += 1
                return None
        try:
            return self._record(name, payload, t_recv_ns, system, component)
        except Exception as error:  # of any kind: it costs this frame
            self._on_error(name, error)
            return None

    def _record(self, name: str, payload: bytes, t_recv_ns: int, system: int, component: int) -> Message | None:
        read = self._convert.get(name)
        if read is not None:
            layout, convert = read
            fields = layout.fields(payload)
            return convert(fields, layout.header(fields, t_recv_ns, system, component))
        if name == "LANDING_TARGET":
            fields = LANDING_TARGET.fields(payload)
            header = LANDING_TARGET.header(fields, t_recv_ns, system, component)
            trackers = self._trackers
            is_whole = trackers.takes_landing_targets
            return trackers.landing_target(fields, header) if is_whole else self._points.add(fields, header)
        if name == "CAMERA_TRACKING_IMAGE_STATUS":
            fields = TRACKING.fields(payload)
            return self._trackers.tracking(fields, TRACKING.header(fields, t_recv_ns, system, component))
        if name == "CAMERA_FOV_STATUS":
            fields = FIELD_OF_VIEW.fields(payload)
            return self._trackers.field_of_view(fields, FIELD_OF_VIEW.header(fields, t_recv_ns, system, component))
        return None


def frame_error(frame: bytes) -> str:
    """Return the reason why the bytes of one frame are invalid, empty if they are valid."""
    if frame[0] == V2 and frame[2] & ~SIGNED:
        return "bad_frame"
    head, number, *_ = parse_header(frame)
    known = MESSAGE_NAMES.get(number)
    if known is None:
        return UNKNOWN  # without its CRC_EXTRA the checksum cannot be tested
    return "" if is_sound(frame, head + frame[1], known[1]) else "bad_frame"


def is_sound(frame: bytes, end: int, extra: bytes) -> bool:
    """Whether the checksum at `end` of a frame is right, for the message's mirrored CRC_EXTRA."""
    mirrored = frame.translate(MIRRORED)
    return crc_hqx(extra, crc_hqx(mirrored[1:end], 0xFFFF)) == mirrored[end] << 8 | mirrored[end + 1]
