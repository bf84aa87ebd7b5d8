"""Framing of MAVLink bytes: cut streams, damage, unknown and signed frames, random bytes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from onboard.messages import Message
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.mavlink_frames import NED_V2, RECEIVE_TIME_NS, decode, frame
from tests.support.mavlink_records import RECORDS


def flight_bytes(n: int = 40) -> tuple[bytes, list[Message]]:
    encoder = MavlinkEncoder(1, 1)
    data = b"".join(encoder.encode(RECORDS[i % len(RECORDS)][0]) for i in range(n))
    return data, decode(data)


def test_a_stream_cut_at_every_byte_gives_the_same_messages() -> None:
    data, whole = flight_bytes()
    assert len(whole) == 40
    for cut in range(len(data)):
        decoder = MavlinkDecoder(stream=True)
        assert decoder.decode(data[:cut], RECEIVE_TIME_NS) + decoder.decode(data[cut:], RECEIVE_TIME_NS) == whole
    decoder = MavlinkDecoder(stream=True)
    assert [m for i in range(len(data)) for m in decoder.decode(data[i : i + 1], RECEIVE_TIME_NS)] == whole
    assert not decoder.rejected


def test_the_buffer_of_a_stream_whose_reads_end_mid_frame_stays_small() -> None:
    decoder = MavlinkDecoder(stream=True)
    unit = bytes.fromhex(NED_V2)
    data = unit * 3
    largest = found = 0
    for _ in range(100_000):  # always the tail of one frame and the head of the next
        found += len(decoder.decode(data[20 : 20 + len(unit)], RECEIVE_TIME_NS))
        largest = max(largest, len(decoder._rest))
    assert found >= 99_999
    assert largest < 300


def test_a_truncated_datagram_does_not_eat_the_next() -> None:
    unit = bytes.fromhex(NED_V2)
    for length in range(1, len(unit)):
        decoder = MavlinkDecoder(stream=False)
        assert decoder.decode(unit[:length], RECEIVE_TIME_NS) == []
        assert len(decoder.decode(unit, RECEIVE_TIME_NS)) == 1, f"eaten after {length} bytes"
        assert decoder.rejected["truncated"] == 1


def test_a_false_start_in_a_stream_costs_little() -> None:
    data = bytes.fromhex(NED_V2)
    decoder = MavlinkDecoder(stream=True)
    found = decoder.decode(b"\x00\x11\x22" + data[:9] + data * 20, RECEIVE_TIME_NS)
    assert len(found) == 20
    assert decoder.rejected["bad_frame"] >= 1


def test_one_wrong_bit_anywhere_rejects_the_frame_and_is_counted() -> None:
    """Once, also where a wrong length leaves bytes behind the frame. Nothing after it is lost."""
    data = bytes.fromhex(NED_V2)
    for bit in range(8 * len(data)):
        byte = bit // 8
        if byte in (2, 3):  # flags: of signing and compatibility, tested on their own
            continue
        wrong = bytearray(data)
        wrong[byte] ^= 1 << bit % 8
        decoder = MavlinkDecoder(stream=False)
        assert decoder.decode(bytes(wrong), RECEIVE_TIME_NS) == []
        assert not decoder.names
        (reason, count), *others = decoder.rejected.items()
        assert others == []
        assert count == 1
        may_be = {1: {"truncated"}, 7: {"unknown_message"}, 8: {"unknown_message"}, 9: {"unknown_message"}}
        assert reason in {"bad_frame"} | may_be.get(byte, set())
        assert decoder.decode(data, RECEIVE_TIME_NS) == decode(data)


def test_a_bad_checksum_is_counted_and_the_next_frame_of_the_datagram_read() -> None:
    data = bytes.fromhex(NED_V2)
    decoder = MavlinkDecoder(stream=False)
    assert len(decoder.decode(data[:-1] + b"\x00" + data, RECEIVE_TIME_NS)) == 1
    assert decoder.rejected == {"bad_frame": 1}


@pytest.mark.parametrize("stream", [False, True], ids=["datagram", "stream"])
@pytest.mark.parametrize(
    "head", ["fd 20 00 00 01 01 01 20 00 00", "fe 40 01 01 01 20", "fd 30 00 00 01 01 01 ff ff ff"]
)
def test_a_false_start_eats_none_of_the_frames_within_its_length(head: str, stream: bool) -> None:
    data = bytes.fromhex(NED_V2)
    decoder = MavlinkDecoder(stream=stream)
    assert len(decoder.decode(data + bytes.fromhex(head) + data * 3, RECEIVE_TIME_NS)) == 4
    assert sum(decoder.rejected.values()) == 1


def test_a_false_start_whose_length_goes_beyond_the_datagram_eats_nothing() -> None:
    data = bytes.fromhex(NED_V2)
    assert len(decode(bytes.fromhex("fd ff 00") + data * 3)) == 3


def test_noise_costs_a_stream_no_whole_frame_with_seed_5() -> None:
    rng, good = np.random.default_rng(5), bytes.fromhex(NED_V2)
    pieces = []
    for _ in range(3000):
        noise = rng.integers(0, 256, rng.integers(0, 40), dtype=np.uint8).tobytes()
        pieces.append(noise + good)
    decoder = MavlinkDecoder(stream=True)
    found = sum(len(decoder.decode(piece, RECEIVE_TIME_NS)) for piece in [*pieces, bytes(300)])
    assert found == 3000


def test_the_number_of_a_message_has_three_bytes() -> None:
    """32 is LOCAL_POSITION_NED, and 65,536 + 32 is nobody's."""
    data = bytearray.fromhex(NED_V2)
    assert data[7:10] == b"\x20\0\0"
    data[9] = 1
    decoder = MavlinkDecoder(stream=False)
    assert decoder.decode(bytes(data), RECEIVE_TIME_NS) == []
    assert decoder.rejected == {"unknown_message": 1}


def test_unknown_messages_are_counted_and_do_no_harm() -> None:
    decoder = MavlinkDecoder(stream=False)
    unknown = frame(60_001, 17, b"\x01\x02\x03")
    assert len(decoder.decode(unknown + bytes.fromhex(NED_V2), RECEIVE_TIME_NS)) == 1
    assert decoder.rejected == {"unknown_message": 1}
    assert decoder.names == {"LOCAL_POSITION_NED": 1}


def test_known_messages_we_do_not_use_are_counted_by_name() -> None:
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    decoder = MavlinkDecoder(stream=False)
    assert decoder.decode(sender.vfr_hud_encode(9.0, 8.0, 90, 50, 100.0, 1.0).pack(sender), RECEIVE_TIME_NS) == []
    assert decoder.names == {"VFR_HUD": 1}
    assert not decoder.rejected


def test_signed_frames_are_read() -> None:
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.signing.secret_key = b"k" * 32
    sender.signing.sign_outgoing = True
    sender.signing.link_id = 1
    sender.signing.timestamp = 1
    data = sender.local_position_ned_encode(123456, 1.5, -2.25, -30.5, 0.125, -0.5, 4.0).pack(sender)
    assert data[2] == 1
    decoder = MavlinkDecoder(stream=False)
    assert len(decoder.decode(data + data, RECEIVE_TIME_NS)) == 2


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.binary(max_size=400), max_size=6), st.booleans())
def test_random_bytes_never_raise(chunks: list[bytes], stream: bool) -> None:
    decoder = MavlinkDecoder(stream=stream)
    for chunk in chunks:
        decoder.decode(chunk, RECEIVE_TIME_NS)


NUMBERS = sorted(common.mavlink_map)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.sampled_from(NUMBERS), st.binary(max_size=255), st.booleans(), st.sampled_from([1, 2]))
def test_random_payloads_of_real_messages_with_good_checksums_eat_nothing(
    number: int, payload: bytes, stream: bool, version: int
) -> None:
    if version == 1 and number > 255:
        return
    extra = common.mavlink_map[number].crc_extra
    decoder = MavlinkDecoder(stream=stream)
    good = bytes.fromhex(NED_V2)
    found = decoder.decode(frame(number, extra, payload, version=version) + good, RECEIVE_TIME_NS)
    assert found[-1:] == decode(good)


def test_random_payloads_of_every_message_we_convert_with_seed_8() -> None:
    rng = np.random.default_rng(8)
    for number, kind in common.mavlink_map.items():
        for _ in range(20):
            size = kind.unpacker.size
            payload = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
            decoder = MavlinkDecoder(stream=False)
            decoder.decode(frame(number, kind.crc_extra, payload), RECEIVE_TIME_NS)
            assert sum(decoder.names.values()) + decoder.rejected["unknown_message"] == 1
