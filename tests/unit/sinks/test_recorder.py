"""The recorder and its reader: bit for bit, cut off, damaged, not ours."""

import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from onboard.messages import Datagram, Encoding
from onboard.sinks import SinkError
from onboard.sinks.recorder import Recorder
from onboard.wire.logs.recording import is_recording, read_recording
from onboard.wire.logs.tlog import NotALogError
from tests.support.records import make_estimate, read_estimates

CHANNELS = (
    ("autopilot", Encoding.MAVLINK_STREAM),
    ("gcs", Encoding.MAVLINK),
    ("onboard/1/camera/front/points", Encoding.POINTS),
)


def datagrams(count: int) -> list[Datagram]:
    """Of all kinds, every byte value, times that go back now and then as those of several threads do."""
    found = []
    for n in range(count):
        channel, encoding = CHANNELS[n % 3]
        data = bytes((n + k) % 256 for k in range(n * 7 % 300 + 1))
        t_recv_ns = 1_700_000_000_000_000_000 + n * 1_000_003 - (n % 5) * 3_000_000
        waited_us = n % 2 * n * 4_294_967
        found.append(
            Datagram(channel=channel, encoding=encoding, t_recv_ns=t_recv_ns, data=data, waited_us=waited_us)
        )
    return found


def record(path: Path, records: list[Any], flush_every: int | None = None) -> Path:
    clock = iter(range(10**9)) if flush_every else None
    recorder = Recorder(path, monotonic=(lambda: float(next(clock))) if clock else lambda: 0.0)
    recorder.open()
    step = flush_every or len(records) or 1
    for at in range(0, len(records), step):
        recorder.write(records[at : at + step])
    recorder.close()
    return recorder.path


def read(path: Path) -> list[Datagram | None]:
    return [datagram for datagram, _ in read_recording(path)]


@pytest.mark.parametrize("flush_every", [None, 7])
def test_every_datagram_comes_back_bit_for_bit_in_the_order_it_was_fed(
    tmp_path: Path, flush_every: int | None
) -> None:
    wanted = datagrams(1000)
    path = record(tmp_path / "flight.mcap", wanted, flush_every)
    assert is_recording(path)
    assert read(path) == wanted
    consumed = [at for _, at in read_recording(path)]
    assert consumed == sorted(consumed)
    assert consumed[-1] <= path.stat().st_size


def test_estimates_stand_beside_with_their_schema_at_the_time_of_the_datagram_that_caused_them(
    tmp_path: Path,
) -> None:
    raw = datagrams(3)
    path = record(tmp_path / "flight.mcap", [raw[0], make_estimate(0), raw[1], raw[2], make_estimate(1)])
    assert read(path) == raw
    assert list(read_estimates(path)) == [make_estimate(0), make_estimate(1)]
    with path.open("rb") as file:  # the library's own reader, as other tools use it
        found = list(make_reader(file).iter_messages(topics=["estimate/ukf"], log_time_order=False))
    assert [message.log_time for _, _, message in found] == [raw[0].t_recv_ns, raw[2].t_recv_ns]
    schema, channel, message = found[0]
    assert (schema.name, schema.encoding, channel.message_encoding) == ("Estimate", "jsonschema", "json")
    assert set(json.loads(schema.data)["$defs"]["Estimate"]["required"]) <= set(json.loads(message.data))


def test_an_existing_recording_is_never_overwritten(tmp_path: Path) -> None:
    wanted = tmp_path / "deep" / "flight.mcap"
    paths = [record(wanted, datagrams(n)) for n in (1, 2, 3)]
    assert [p.name for p in paths] == ["flight.mcap", "flight-2.mcap", "flight-3.mcap"]
    assert [len(read(p)) for p in paths] == [1, 2, 3]


def test_a_folder_that_cannot_be_written_to_is_a_sink_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    recorder = Recorder(tmp_path / "file" / "flight.mcap")
    for attempt in (recorder.check, recorder.open):
        with pytest.raises(SinkError, match="cannot record to"):
            attempt()
    recorder.close()


def test_nothing_but_the_latest_second_is_unflushed(tmp_path: Path) -> None:
    now = [0.0]
    recorder = Recorder(tmp_path / "flight.mcap", monotonic=lambda: now[0])
    recorder.open()
    wanted = datagrams(30)
    for n, datagram in enumerate(wanted):
        now[0] = n * 0.1
        recorder.write([datagram])
    assert read(recorder.path) == [*wanted[:28], None]  # at 0.9, 1.8 and 2.7 s; the file has no end yet
    now[0] = 3.6
    recorder.write([])
    assert read(recorder.path) == [*wanted, None]
    recorder.close()
    assert read(recorder.path) == wanted


def test_a_recording_cut_anywhere_yields_what_it_has_and_says_that_it_was_cut(tmp_path: Path) -> None:
    wanted = datagrams(60)
    whole = record(tmp_path / "flight.mcap", wanted, flush_every=20).read_bytes()
    cut = tmp_path / "cut.mcap"
    counts = set()
    for length in range(8, len(whole), 13):
        cut.write_bytes(whole[:length])
        found = read(cut)
        assert found[-1] is None
        assert found.count(None) == 1
        assert found[:-1] == wanted[: len(found) - 1]
        counts.add(len(found) - 1)
    assert counts == {0, 20, 40, 60}


def test_damage_in_the_middle_costs_the_chunk_it_hit_and_is_reported_once(tmp_path: Path) -> None:
    wanted = datagrams(60)
    whole = bytearray(record(tmp_path / "flight.mcap", wanted, flush_every=20).read_bytes())
    damaged = tmp_path / "damaged.mcap"
    first_chunk = min(at for _, at in read_recording(tmp_path / "flight.mcap"))
    for at in range(first_chunk + 200, first_chunk + 1000, 37):  # inside the second chunk's data
        bad = bytearray(whole)
        bad[at] ^= 0xFF
        damaged.write_bytes(bad)
        found = read(damaged)
        good = [d for d in found if d is not None]
        assert found.count(None) <= 1
        assert good in ([*wanted[:20], *wanted[40:]], wanted)  # or hit an index nobody reads


def test_damage_anywhere_never_raises(tmp_path: Path) -> None:
    whole = record(tmp_path / "flight.mcap", datagrams(60), flush_every=20).read_bytes()
    damaged = tmp_path / "damaged.mcap"
    for at in range(8, len(whole), 11):
        bad = bytearray(whole)
        bad[at] ^= 0x81
        damaged.write_bytes(bad)
        assert all(d is None or isinstance(d, Datagram) for d in read(damaged))


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"not a log at all", bytes(100)])
def test_what_is_no_recording_is_refused_at_once(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    assert not is_recording(path)
    with pytest.raises(NotALogError, match=r"flight\.mcap"):
        next(read_recording(path))


def test_an_estimate_of_another_version_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_message(writer.register_channel("estimate/ukf", "json", 0), 1, b'{"name":"ukf"}', 1)
        writer.finish()
    assert list(read_estimates(path)) == []
