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
    CHECKSUM_SIZE,
    MESSAGES,
    MIRRORED,
    SIGNATURE_SIZE,
    SIGNED,
    V2,
    V2_HEADER_SIZE,
)

DIGEST_SIZE: Final = 6
EPOCH_NS: Final = 1_420_070_400 * 10**9  # 2015-01-01, UTC
STAMP_RESOLUTION_NS: Final = 10_000
MAX_STAMP_OFFSET: Final = 6_000_000  # 60 s, from now, of any frame ahead and of the first one behind
MIN_UNIX_TIME_NS: Final = 1_704_067_200 * 10**9  # 2024-01-01: a clock that shows an earlier time was never set
KEY_BYTES: Final = 32
MAX_TYPO_COUNT: Final = 4  # characters by which a 64-digit key may be mistyped and is still no passphrase
HEX_DIGITS: Final = b"0123456789abcdefABCDEF"
SEPARATORS: Final = re.compile(rb"[\s:,-]|(?<=[\s,])0x")
MAX_STREAM_COUNT: Final = 256

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
    """Verifier of the signatures on one link, for whole frames whose checksum is right.

    `on_refused` receives the reason and the arrival if a person must set a key or a clock. `stamps` are shared by
    all links of the key. Without a key (None), signed frames pass and are counted in `unverified`.
    """

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
        """Return why a frame is refused, "" if it is signed with our key and its stamp is new.

        `wall_step_ns` is the wall clock minus the clock of arrivals.
        """
        if frame[0] != V2 or not frame[2] & SIGNED:
            self._on_refused(UNSIGNED, t_recv_ns)
            return "unsigned"
        if self._key is None:
            self.unverified += 1
            return ""
        if not hmac.compare_digest(digest(self._key, frame[:-DIGEST_SIZE]), frame[-DIGEST_SIZE:]):
            self._on_refused(FORGED, t_recv_ns)
            return "forged"
        stream = frame[-SIGNATURE_SIZE], frame[5], frame[6]
        stamp = int.from_bytes(frame[-SIGNATURE_SIZE + 1 : -DIGEST_SIZE], "little")
        newest, now = self._newest.get(stream), stamp_of(t_recv_ns + wall_step_ns)
        if stamp > now + MAX_STAMP_OFFSET or (newest is None and stamp < now - MAX_STAMP_OFFSET):
            if len(self._reasons) < MAX_STREAM_COUNT:
                words = _describe_clock_error(stamp, t_recv_ns + wall_step_ns, stream)
                self._reasons.setdefault(stream, Reason(Cause.SIGNING, words))
            if stream in self._reasons:
                self._on_refused(self._reasons[stream], t_recv_ns)
            return "signed_ahead" if stamp > now else "replayed"
        if (newest is not None and stamp <= newest) or (newest is None and len(self._newest) >= MAX_STREAM_COUNT):
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
        """Sign a MAVLink 2 frame, with a stamp that rises even if the clock does not.

        Raises KeyError for a message that is not ours to send.
        """
        self._last = max(self._last + 1, stamp_of(now_ns))
        flagged = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3 : V2_HEADER_SIZE + frame[1]]
        number = int.from_bytes(frame[7:10], "little")
        whole = flagged + checksum(flagged[1:], MESSAGES[number][1])
        whole += bytes([self._link_id]) + self._last.to_bytes(6, "little")
        return whole + digest(self._key, whole)


def digest(key: bytes, signed: bytes) -> bytes:
    """The signature (6) of a frame up to its stamp."""
    return hashlib.sha256(key + signed).digest()[:DIGEST_SIZE]


def stamp_of(unix_ns: int) -> int:
    """A time as a signature's stamp."""
    return max(unix_ns - EPOCH_NS, 0) // STAMP_RESOLUTION_NS


def _describe_clock_error(stamp: int, wall_ns: int, stream: StreamId) -> str:
    """In words, which clock is wrong, where signed frames are far from now."""
    _, system, component = stream
    signed_ns = EPOCH_NS + stamp * STAMP_RESOLUTION_NS
    if wall_ns < MIN_UNIX_TIME_NS:
        return f"signed frames: this computer's clock shows {_format_time(wall_ns)}; set it (NTP, GPS, RTC)"
    who = f"system {system}, component {component}"
    if signed_ns < MIN_UNIX_TIME_NS:
        return f"signed frames: the clock of {who} shows {_format_time(signed_ns)}; set it"
    which = "ahead of" if signed_ns > wall_ns else "behind"
    return (
        f"signed frames: the clock of {who} is {which} this computer's ({_format_time(wall_ns)}) by more than "
        f"{MAX_STAMP_OFFSET * STAMP_RESOLUTION_NS // 10**9} s: "
        f"it shows {_format_time(signed_ns)}; set the wrong one, or stop whoever replays them"
    )


def _format_time(unix_ns: int) -> str:
    """Format a Unix time as date and time, or in seconds if no calendar has it."""
    try:
        return datetime.fromtimestamp(unix_ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M")
    except (OverflowError, ValueError, OSError):
        return f"{unix_ns // 10**9} s"


def checksum(covered: bytes, extra: int) -> bytes:
    """MAVLink's checksum of what it covers: all but the first byte."""
    mirrored = (covered + bytes([extra])).translate(MIRRORED)
    return crc_hqx(mirrored, 0xFFFF).to_bytes(CHECKSUM_SIZE, "big").translate(MIRRORED)


def read_key(text: bytes) -> bytes | None:
    """Read a key (32 bytes) from 64 hexadecimal digits, or as the SHA-256 of a passphrase.

    Returns None for an empty text. Raises ValueError for a text that is nearly 64 digits, which a slip would
    silently turn into a passphrase.
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
    if abs(len(packed) - 2 * KEY_BYTES) <= MAX_TYPO_COUNT and wrong <= MAX_TYPO_COUNT:
        digits = f"{len(packed)} characters, of which {wrong} are no hexadecimal digits"
        raise ValueError(f"is nearly a key: {digits}; expected 64 digits and nothing else, or a passphrase")
    return hashlib.sha256(line).digest()
