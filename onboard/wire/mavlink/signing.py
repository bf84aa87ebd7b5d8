"""MAVLink 2 signatures: made for what is sent on a link, and tested on what arrives on it.

A signature is the first 6 bytes of SHA-256 over the key and the frame with its link id and its time stamp, in
units of 10 us since 2015. A stream (link id, system, component) accepts only rising stamps, and none that is far
from now: one from the future would refuse the owner's own until then. All links of a key share its stamps: what
came on one of them is a replay on every other. The digest is compared first: a forged frame must not move the
stamp, or it would block the stream. Stamps are of the wall clock, which may be set at any
time, so they are compared with it.
"""

import hashlib
import hmac
import re
from binascii import crc_hqx
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final

from onboard.messages.causes import Cause, Reason
from onboard.wire.mavlink.frame import (
    CHECKSUM,
    MIRRORED,
    SIGNATURE,
    SIGNED,
    UNLISTED,
    V2,
    V2_HEAD,
)
from onboard.wire.mavlink.table import MESSAGES

DIGEST: Final = 6
STAMP: Final = 6
EPOCH_NS: Final = 1_420_070_400 * 10**9  # 2015-01-01, UTC
UNIT_NS: Final = 10_000
NEW_STREAM: Final = 6_000_000  # 60 s: a stream that is new may be this much older than now
NEWEST_STAMP: Final = 6_000_000  # 60 s: no frame may be this much newer than now
SET_SINCE: Final = 1_704_067_200 * 10**9  # 2024-01-01: a clock that says less was never set
KEY_BYTES: Final = 32
KEY_TYPOS: Final = 4  # characters by which a key of 64 digits may be mistaken and is still no passphrase
HEX_DIGITS: Final = b"0123456789abcdefABCDEF"
SEPARATORS: Final = re.compile(rb"[\s:,-]|(?<=[\s,])0x")
MOST_STREAMS: Final = 256
EXTRA: Final = {number: extra for number, (_, extra) in (MESSAGES | UNLISTED).items()}

UNSIGNED: Final = Reason(
    Cause.SIGNING,
    "frames are not signed, and this link has a `key_file`; give the sender its key, and MAVLink 2",
)
FORGED: Final = Reason(
    Cause.SIGNING, "frames are signed with another key than that of this link's `key_file`; give both the same"
)

OnRefused = Callable[[Reason, int], None]
StreamId = tuple[int, int, int]  # link id, system, component
Stamps = dict[StreamId, int]  # the newest by stream


class Verifier:
    """Tests the frames of one link. `check` is given whole frames whose checksum is right. `on_refused` is called
    with the reason and the arrival where a person must set a key or a clock. `stamps`: those of all links of the
    key, which it reads and writes. Where the key is not at hand (None), what is signed passes and is counted in
    `unverified`."""

    def __init__(
        self,
        key: bytes | None,
        on_refused: OnRefused = lambda _why, _t_recv_ns: None,
        stamps: Stamps | None = None,
    ) -> None:
        self.unverified = 0
        self._key, self._on_refused = key, on_refused
        self._newest: Stamps = {} if stamps is None else stamps
        self._reasons: dict[StreamId, Reason] = {}  # as first said, so that one cause stays one line

    def check(self, frame: bytes, t_recv_ns: int, wall_step_ns: int = 0) -> str:
        """Why a frame is refused; nothing if it is signed with our key, new, and of about now. Only then its stamp
        counts. `wall_step_ns`: the wall clock less that of arrivals."""
        if frame[0] != V2 or not frame[2] & SIGNED:
            self._on_refused(UNSIGNED, t_recv_ns)
            return "unsigned"
        if self._key is None:
            self.unverified += 1
            return ""
        if not hmac.compare_digest(digest(self._key, frame[:-DIGEST]), frame[-DIGEST:]):
            self._on_refused(FORGED, t_recv_ns)
            return "forged"
        stream = frame[-SIGNATURE], frame[5], frame[6]
        stamp = int.from_bytes(frame[-SIGNATURE + 1 : -DIGEST], "little")
        newest, now = self._newest.get(stream), stamp_of(t_recv_ns + wall_step_ns)
        if stamp > now + NEWEST_STAMP or (newest is None and stamp < now - NEW_STREAM):
            if len(self._reasons) < MOST_STREAMS:
                words = _which_clock(stamp, t_recv_ns + wall_step_ns, stream)
                self._reasons.setdefault(stream, Reason(Cause.SIGNING, words))
            if stream in self._reasons:
                self._on_refused(self._reasons[stream], t_recv_ns)
            return "signed_ahead" if stamp > now else "replayed"
        if (newest is not None and stamp <= newest) or (newest is None and len(self._newest) >= MOST_STREAMS):
            return "replayed"
        self._newest[stream] = stamp
        self._reasons.pop(stream, None)
        return ""


class Signer:
    """Signs the frames of one link."""

    def __init__(self, key: bytes, link_id: int) -> None:
        self._key, self._link_id = key, link_id
        self._last = 0

    def sign(self, frame: bytes, now_ns: int) -> bytes:
        """A frame of MAVLink 2 that is not signed, with a signature. Its stamp rises even if the clock does not.

        Raises KeyError for a message that is not ours to send.
        """
        self._last = max(self._last + 1, stamp_of(now_ns))
        flagged = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3 : V2_HEAD + frame[1]]
        number = int.from_bytes(frame[7:10], "little")
        whole = flagged + checksum(flagged[1:], EXTRA[number])
        whole += bytes([self._link_id]) + self._last.to_bytes(STAMP, "little")
        return whole + digest(self._key, whole)


def digest(key: bytes, signed: bytes) -> bytes:
    """The signature (6) of a frame up to its stamp."""
    return hashlib.sha256(key + signed).digest()[:DIGEST]


def stamp_of(unix_ns: int) -> int:
    """A time as a signature's stamp."""
    return max(unix_ns - EPOCH_NS, 0) // UNIT_NS


def _which_clock(stamp: int, wall_ns: int, stream: StreamId) -> str:
    """In words, which clock is wrong, where signed frames are far from now."""
    _, system, component = stream
    signed_ns = EPOCH_NS + stamp * UNIT_NS
    if wall_ns < SET_SINCE:
        return f"signed frames: this computer's clock is not set, it says {_day(wall_ns)}; set it (NTP, GPS, RTC)"
    who = f"system {system}, component {component}"
    if signed_ns < SET_SINCE:
        return f"signed frames: the clock of {who} is not set, it signs as of {_day(signed_ns)}; set it"
    which = "ahead of" if signed_ns > wall_ns else "behind"
    return (
        f"signed frames: the clock of {who} is {which} this computer's, which says {_day(wall_ns)}, by more than "
        f"{NEWEST_STAMP * UNIT_NS // 10**9} s: "
        f"it signs as of {_day(signed_ns)}; set the wrong one, or they are replayed"
    )


def _day(unix_ns: int) -> str:
    """A time as a day; one that no calendar has, in seconds."""
    try:
        return datetime.fromtimestamp(unix_ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M")
    except (OverflowError, ValueError, OSError):
        return f"{unix_ns // 10**9} s"


def checksum(covered: bytes, extra: int) -> bytes:
    """MAVLink's checksum of what it covers: all but the first byte."""
    mirrored = (covered + bytes([extra])).translate(MIRRORED)
    return crc_hqx(mirrored, 0xFFFF).to_bytes(CHECKSUM, "big").translate(MIRRORED)


def read_key(text: bytes) -> bytes | None:
    """The key (32) of a file's content: 64 hexadecimal digits, or a passphrase, of which ground stations take the
    SHA-256. None for an empty one. Editors of Windows put a mark before the text.

    Raises ValueError for what is nearly 64 digits: a slip would silently become a passphrase.
    """
    line = text.removeprefix(BOM_UTF8).strip()
    if not line:
        return None
    if line.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        raise ValueError("is UTF-16; save it as UTF-8")
    try:
        key = bytes.fromhex(line.decode("ascii"))
    except (UnicodeDecodeError, ValueError):
        key = b""
    if len(key) == KEY_BYTES:
        return key
    packed = SEPARATORS.sub(b"", line.removeprefix(b"0x"))
    wrong = len(packed.translate(None, HEX_DIGITS))
    if abs(len(packed) - 2 * KEY_BYTES) <= KEY_TYPOS and wrong <= KEY_TYPOS:
        digits = f"{len(packed)} characters, of which {wrong} are no hexadecimal digits"
        raise ValueError(f"is nearly a key: {digits}; expected 64 digits and nothing else, or a passphrase")
    return hashlib.sha256(line).digest()
