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


@pytest.mark.parametrize("stream", [False, True], ids=["datagram", "stream"])
@pytest.mark.parametrize(
    "head", ["fd 20 00 00 01 01 01 20 00 00", "fe 40 01 01 01 20", "fd 30 00 00 01 01 01 ff ff ff"]
)
def test_a_false_start_eats_none_of_the_frames_within_its_length(head: str, stream: bool) -> None:
    data = bytes.fromhex(NED_V2)
    decoder = MavlinkDecoder(stream=stream)
    assert len(decoder.decode(data + bytes.fromhex(head) + data * 3, RECEIVE_TIME_NS)) == 4
    assert sum(decoder.rejected.values()) == 1


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
