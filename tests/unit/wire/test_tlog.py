"""Recordings as ground stations write them: whole, damaged, cut off, or another kind of file."""

import io
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.messages import Encoding
from onboard.wire.logs import tlog
from onboard.wire.logs.tlog import NotALogError, read_tlog, tlog_record
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.frame import frame_length
from tests.support.streams import STRAIGHT, Stream

DATAGRAMS = Stream(flight=STRAIGHT, t1=6.0, images=lambda _t: False).datagrams()
LOG = b"".join(tlog_record(d.t_recv_ns, d.data) for d in DATAGRAMS)


def records(log: bytes) -> list[Any]:
    return [datagram for datagram, _ in read_tlog(log)]


def test_a_log_gives_back_what_was_written() -> None:
    found = records(LOG)
    assert [d.data for d in found] == [d.data for d in DATAGRAMS]
    assert [d.t_recv_ns for d in found] == [d.t_recv_ns // 1000 * 1000 for d in DATAGRAMS]
    assert {d.encoding for d in found} == {Encoding.MAVLINK}
    assert list(read_tlog(LOG))[-1][1] == len(LOG)


def test_the_time_stamp_is_big_endian_unix_microseconds() -> None:
    assert tlog_record(1_735_689_605_123_456_789, b"") == struct.pack(">Q", 1_735_689_605_123_456)


def test_garbage_in_the_middle_is_reported_once_and_costs_only_itself() -> None:
    cut = sum(8 + len(d.data) for d in DATAGRAMS[:30])
    garbage = np.random.default_rng(2).integers(0, 200, 500, dtype=np.uint8).tobytes()
    found = records(LOG[:cut] + garbage + LOG[cut:])
    assert found.count(None) == 1
    assert found[30] is None
    assert [d.data for d in found if d is not None] == [d.data for d in DATAGRAMS]


@pytest.mark.parametrize("damage", [0, 7, 8, 9, 3000], ids=lambda at: f"up to byte {at}")
def test_damage_at_the_begin_costs_what_is_damaged(damage: int) -> None:
    """The whole log was refused for its first byte."""
    found = records(b"\xff" * (damage + 1) + LOG[damage + 1 :])
    first = next(i for i in range(len(DATAGRAMS)) if sum(8 + len(d.data) for d in DATAGRAMS[:i]) > damage)
    assert found[0] is None
    assert [d.data for d in found[1:]] == [d.data for d in DATAGRAMS[first:]]


def test_damage_that_hides_a_header_costs_that_record() -> None:
    damaged = bytearray(LOG)
    damaged[sum(8 + len(d.data) for d in DATAGRAMS[:10]) + 8] = 0x00
    found = records(bytes(damaged))
    assert found.count(None) == 1
    assert len(found) == len(DATAGRAMS)


@pytest.mark.parametrize("length", [0, 5, 200, 255])
def test_a_wrong_length_costs_that_record_alone(length: int) -> None:
    damaged = bytearray(LOG)
    at = sum(8 + len(d.data) for d in DATAGRAMS[:10]) + 8
    assert damaged[at + 1] != length
    damaged[at + 1] = length
    found = records(bytes(damaged))
    assert [d.data for d in found if d is not None] == [d.data for d in (*DATAGRAMS[:10], *DATAGRAMS[11:])]
    assert found.count(None) == 1


def test_a_log_cut_off_anywhere_gives_all_whole_records() -> None:
    short = LOG[: sum(8 + len(d.data) for d in DATAGRAMS[:5])]
    ends = np.cumsum([8 + len(d.data) for d in DATAGRAMS[:5]])
    for length in range(9, len(short)):
        found = records(short[:length])
        whole = int((ends <= length).sum())
        assert sum(d is not None for d in found) == whole, length
        assert found.count(None) == (0 if length in ends else 1), length


@pytest.mark.parametrize("data", [b"", b"\0", b"\0" * 8, b"\0" * 100, b"hello, this is some text, no log at all"])
def test_another_kind_of_file_is_refused_at_once(data: bytes) -> None:
    with pytest.raises(NotALogError, match=r"no \.tlog"):
        next(iter(read_tlog(data)))


def test_frame_lengths_of_both_versions_and_of_signed_ones() -> None:
    for head, length in ((b"\xfe\x09\0", 17), (b"\xfd\x09\0", 21), (b"\xfd\x09\x01", 34), (b"\xfd\x09", None)):
        assert frame_length(head, 0) == length
    assert frame_length(b"\0\0\0\0", 0) is None


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(9, len(LOG) - 1), st.binary(max_size=200))
def test_a_log_with_anything_in_it_never_raises(at: int, noise: bytes) -> None:
    decoder = MavlinkDecoder(stream=False)
    for datagram, consumed in read_tlog(LOG[:at] + noise + LOG[at:][:400]):
        assert consumed <= len(LOG) + 200
        if datagram is not None:
            decoder.decode(datagram.data, datagram.t_recv_ns)


def test_a_stamp_is_of_the_years_until_2100() -> None:
    frame, us = DATAGRAMS[0].data, 1_000
    new_year = 4_102_444_800 * 10**9
    for t_ns in (0, new_year - us):
        assert [d.t_recv_ns for d in records(tlog_record(t_ns, frame))] == [t_ns]
    with pytest.raises(NotALogError):
        records(tlog_record(new_year, frame))


@pytest.mark.parametrize("block", [1024, 1037, 4000])
def test_a_file_read_by_blocks_gives_the_same_seed_4(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    noise = np.random.default_rng(4).integers(0, 256, 2000, dtype=np.uint8).tobytes()
    log = LOG[:3000] + noise + LOG[3000:9000] + b"\xfd"
    whole = list(read_tlog(log))
    assert sum(datagram is None for datagram, _ in whole) >= 2
    monkeypatch.setattr(tlog, "READ_BYTES", block)
    assert list(read_tlog(io.BytesIO(log))) == whole


def test_a_damaged_log_whose_only_record_is_cut_anywhere_is_none() -> None:
    """What is searched for a record ends somewhere in one."""
    first = b"\0" + tlog_record(DATAGRAMS[0].t_recv_ns, DATAGRAMS[0].data)
    assert len(records(first)) >= 1
    for end in range(9, len(first)):
        with pytest.raises(NotALogError):
            records(first[:end])
