"""A set-up with which nothing can be used is named, with what is wanted."""

import json

import pytest

from onboard.messages import Cause, Datagram, Encoding, Reason
from onboard.wire.datagrams import MIN_FRAMELESS_COUNT, DatagramDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.signing import FORGED, UNSIGNED, Signer, read_key
from tests.support.mavlink_records import RECORDS

KEY = bytes(range(32))
NOW = 1_800_000_000 * 10**9
PLAIN = MavlinkEncoder(7, 191).encode(RECORDS[0][0])
JSON = json.dumps({"t_ns": 1, "detections": []}).encode()


def refused(data: bytes, encoding: Encoding, times: int, key: bytes | None = None) -> list[Reason]:
    """Why each of so many pieces of one channel is refused."""
    reasons: list[Reason] = []
    keys = {} if key is None else {"a": key}
    decoder = DatagramDecoder(on_refused=lambda _, why, __: reasons.append(why), keys=keys)
    for _ in range(times):
        decoder.decode(Datagram(channel="a", encoding=encoding, t_recv_ns=NOW, data=data))
    return reasons


@pytest.mark.parametrize(
    ("data", "key", "reason"),
    [(PLAIN, KEY, UNSIGNED), (Signer(bytes(32), 0).sign(PLAIN, NOW), KEY, FORGED)],
    ids=["not signed", "another key"],
)
def test_a_wrong_signing_set_up_is_named(data: bytes, key: bytes, reason: Reason) -> None:
    assert refused(data, Encoding.MAVLINK, 3, key) == [reason] * 3
    assert refused(data, Encoding.MAVLINK, 3) == []


@pytest.mark.parametrize(
    ("data", "hint"),
    [(JSON, "`json:` link"), (b"\x81\xfe\x00\x13" * 20, "baud rate"), (b"$GPGGA,1,2*47\r\n", "baud")],
)
@pytest.mark.parametrize("encoding", [Encoding.MAVLINK, Encoding.MAVLINK_STREAM])
def test_bytes_that_are_no_mavlink_are_named_after_a_while(data: bytes, hint: str, encoding: Encoding) -> None:
    assert refused(data, encoding, MIN_FRAMELESS_COUNT - 1) == []
    (reason,) = refused(data, encoding, MIN_FRAMELESS_COUNT)
    assert hint in reason.words
    assert reason.cause is (Cause.NO_MAVLINK if data == JSON else Cause.BAUD_RATE)
    assert refused(data + PLAIN, encoding, 2 * MIN_FRAMELESS_COUNT) == []


@pytest.mark.parametrize(
    "text",
    [
        KEY.hex()[:-1],
        KEY.hex() + "0",
        "0x" + KEY.hex(),
        ":".join(f"{b:02x}" for b in KEY),
        KEY.hex()[:-1] + "g",
        KEY.hex().replace("0", "O", 3),
        ", ".join(f"0x{b:02x}" for b in KEY),
        KEY.hex().encode("utf-16").decode("latin-1"),
    ],
)
def test_what_is_nearly_a_key_is_no_passphrase(text: str) -> None:
    with pytest.raises(ValueError, match=r"nearly a key|UTF-16"):
        read_key(text.encode("latin-1"))


@pytest.mark.parametrize(
    "text", ["my secret", "deadbeef", "the quick brown fox jumps over the lazy dog, twice or more"]
)
def test_a_passphrase_stays_one_and_a_byte_order_mark_is_no_part_of_it(text: str) -> None:
    assert read_key(b"\xef\xbb\xbf" + text.encode()) == read_key(text.encode()) is not None
    assert read_key(b"\xef\xbb\xbf" + KEY.hex().encode() + b"\r\n") == KEY
