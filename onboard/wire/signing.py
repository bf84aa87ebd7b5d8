"""MAVLink 2 signatures: made for what is sent on a link, and tested on what arrives on it.

A signature is the first 6 bytes of SHA-256 over the key and the frame with its link id and its time stamp, in
units of 10 us since 2015. A stream (link id, system, component) accepts only rising stamps. The digest is compared
first: a forged frame must not move the stamp, or it would block the stream.
"""

import hashlib
import hmac
from binascii import crc_hqx
from typing import Final

from onboard.wire.mavlink_frame import (
    CHECKSUM,
    MIRRORED,
    SIGNATURE,
    SIGNED,
    UNLISTED_EXTRA,
    V2,
    V2_HEAD,
)
from onboard.wire.mavlink_table import MESSAGES

DIGEST: Final = 6
STAMP: Final = 6
EPOCH_NS: Final = 1_420_070_400 * 10**9  # 2015-01-01, UTC
UNIT_NS: Final = 10_000
NEW_STREAM: Final = 6_000_000  # 60 s: a stream that is new may be this much older than now
KEY_BYTES: Final = 32
MOST_STREAMS: Final = 256
EXTRA: Final = {number: extra for number, (_, extra) in MESSAGES.items()} | UNLISTED_EXTRA


class Verifier:
    """Tests the frames of one link. `check` is given whole frames whose checksum is right."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._newest: dict[tuple[int, int, int], int] = {}  # stamp by stream

    def check(self, frame: bytes, t_recv_ns: int) -> str:
        """Why a frame is refused; nothing if it is signed with our key and new. Only then its stamp counts."""
        if frame[0] != V2 or not frame[2] & SIGNED:
            return "unsigned"
        if not hmac.compare_digest(digest(self._key, frame[:-DIGEST]), frame[-DIGEST:]):
            return "forged"
        stream = frame[-SIGNATURE], frame[5], frame[6]
        stamp = int.from_bytes(frame[-SIGNATURE + 1 : -DIGEST], "little")
        newest = self._newest.get(stream)
        oldest = stamp_of(t_recv_ns) - NEW_STREAM if newest is None else newest + 1
        if stamp < oldest or (newest is None and len(self._newest) >= MOST_STREAMS):
            return "replayed"
        self._newest[stream] = stamp
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


def checksum(covered: bytes, extra: int) -> bytes:
    """MAVLink's checksum of what it covers: all but the first byte."""
    mirrored = (covered + bytes([extra])).translate(MIRRORED)
    return crc_hqx(mirrored, 0xFFFF).to_bytes(CHECKSUM, "big").translate(MIRRORED)


def read_key(text: bytes) -> bytes | None:
    """The key (32) of a file's content: 64 hexadecimal digits, or a passphrase, of which ground stations take the
    SHA-256. None for an empty one."""
    line = text.strip()
    if not line:
        return None
    try:
        key = bytes.fromhex(line.decode("ascii"))
    except (UnicodeDecodeError, ValueError):
        key = b""
    return key if len(key) == KEY_BYTES else hashlib.sha256(line).digest()
