"""A flood of estimates never costs a recorded datagram, and a flood of names never ends the recorder."""

import asyncio
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.reader import make_reader

from onboard.messages import Datagram, Encoding, SinkHealth
from onboard.sinks import recorder as recording
from onboard.sinks.recorder import Recorder
from onboard.wire.logs.recording import read_recording
from tests.support.records import make_estimate, read_estimates, record

ESTIMATES_A_DATAGRAM = 20


def datagram(n: int, channel: str = "autopilot", encoding: Encoding = Encoding.MAVLINK) -> Datagram:
    return Datagram(channel=channel, encoding=encoding, t_recv_ns=10**18 + n, data=n.to_bytes(4, "big"))


def recorded_with_a_stalled_disk(path: Path, count: int) -> SinkHealth:
    """Queue `count` datagrams, with many estimates after each, before the recorder's thread runs."""

    async def main() -> SinkHealth:
        runner = recording.runner(Recorder(path))
        for n in range(count):
            runner.put(datagram(n))
            for k in range(ESTIMATES_A_DATAGRAM):
                runner.put(make_estimate(n * ESTIMATES_A_DATAGRAM + k))
        task = asyncio.create_task(runner.run())
        await asyncio.sleep(0)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        return runner.health()

    return asyncio.run(main())


def test_datagrams_never_give_way_to_estimates(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    count = recording.RECORDER_CAPACITY // 4
    health = recorded_with_a_stalled_disk(path, count)
    assert [d for d, _ in read_recording(path)] == [datagram(n) for n in range(count)]
    estimates = len(list(read_estimates(path)))
    assert estimates > 0
    assert (health.dropped, health.dropped_important) == (ESTIMATES_A_DATAGRAM * count - estimates, 0)


def test_datagrams_beyond_the_room_are_counted_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "RECORDER_CAPACITY", 3000)
    path = tmp_path / "flight.mcap"
    beyond = 100
    health = recorded_with_a_stalled_disk(path, 2 * recording.RECORDER_CAPACITY + beyond)
    kept = [d for d, _ in read_recording(path)]
    assert kept[-1] == datagram(2 * recording.RECORDER_CAPACITY + beyond - 1)
    assert len(kept) >= recording.RECORDER_CAPACITY
    assert health.dropped_important == 2 * recording.RECORDER_CAPACITY + beyond - len(kept)


def test_more_names_than_a_file_has_channels_for_cost_estimates_but_no_datagram(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MCAP numbers its channels with 16 bits."""
    assert recording.MAX_CHANNEL_COUNT + recording.MAX_TARGETS < 2**16
    for limit in ("MAX_CHANNEL_COUNT", "MAX_TARGETS"):
        monkeypatch.setattr(recording, limit, 300)
    wanted = [datagram(n, f"onboard/1/camera/{n}/points", Encoding.POINTS) for n in range(1000)]
    made = [make_estimate(n, target=f"target/{n}") for n in range(1000)]
    path = record(tmp_path / "flight.mcap", [*wanted, *made], monotonic=lambda: 0.0)
    found = [d for d, _ in read_recording(path)]
    assert [d.data for d in found if d is not None] == [d.data for d in wanted]
    assert found[:100] == wanted[:100]  # with their own channels, as long as there are some
    assert list(read_estimates(path)) == made[:300]


def test_a_schema_is_written_once_however_many_targets_there_are(tmp_path: Path) -> None:
    made = [make_estimate(n, target=f"target/{n}") for n in range(50)]
    with record(tmp_path / "flight.mcap", made, monotonic=lambda: 0.0).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.schemas) == 1
    assert len(summary.channels) == 50
