"""What lies beyond a limit of docs/security.md, where no other test goes there: it is refused or dropped, counted,
and costs nothing of others."""

import random
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from onboard.config import OwnshipConfig
from onboard.estimators.traffic import track as traffic_track
from onboard.estimators.traffic import waiting as traffic_waiting
from onboard.estimators.traffic.config import Config as TrafficConfig
from onboard.estimators.traffic.track import Track
from onboard.health.monitor import MAX_ERROR_COUNT, Exceptions
from onboard.messages import (
    Clock,
    Datagram,
    Encoding,
    Exposure,
    Pseudoranges,
    SatelliteRange,
    TargetPoints,
    Verdict,
)
from onboard.pipeline.waiting import MAX_WAITING_COUNT, Waiting
from onboard.sinks import zenoh
from onboard.sinks.recorder import Recorder
from onboard.wire.documents import pseudoranges, radar
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.logs import recording
from onboard.wire.mavlink.landing_target import MAX_PENDING_IMAGES, MAX_SENDER_COUNT, PointAssembler
from tests.support.mavlink_frames import RECEIVE_TIME_NS
from tests.support.records import make_estimate
from tests.unit.sinks.test_zenoh_queue import Nothing, waiting
from tests.unit.wire.test_radar import ECHO, document

S = 1_000_000_000


def epoch(satellites: int) -> bytes:
    each = SatelliteRange(satellite="G00", r_e=(2.6e7, 0.0, 0.0), v_e=(0.0, 3e3, 0.0), pseudorange=2e7, rate=0.0)
    names = [msgspec.structs.replace(each, satellite=f"G{k}") for k in range(satellites)]
    whole = Pseudoranges(t_ns=S, clock=Clock.BOOT, peer=7, satellites=tuple(names))
    return msgspec.json.encode(whole)


def test_a_scan_or_an_epoch_with_more_than_any_sensor_has_is_refused() -> None:
    assert len(radar.decode_radar(document(detections=[ECHO] * 1000), RECEIVE_TIME_NS).detections) == 1000
    assert (
        len(pseudoranges.decode_ranges(epoch(pseudoranges.MAX_SATELLITE_COUNT), RECEIVE_TIME_NS).satellites)
        == pseudoranges.MAX_SATELLITE_COUNT
    )
    with pytest.raises(BadDocumentError, match="at most 64 satellites"):
        pseudoranges.decode_ranges(epoch(pseudoranges.MAX_SATELLITE_COUNT + 1), RECEIVE_TIME_NS)


def test_a_scan_that_a_document_could_hold_is_refused_beyond_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(radar, "MAX_ECHO_COUNT", 10)  # 4096 do not fit into the document that may arrive
    assert len(radar.decode_radar(document(detections=[ECHO] * 10), RECEIVE_TIME_NS).detections) == 10
    with pytest.raises(BadDocumentError, match="more than 10 detections"):
        radar.decode_radar(document(detections=[ECHO] * 11), RECEIVE_TIME_NS)


def point(assembler: PointAssembler, system: int, t_us: int, label: int) -> Any:
    fields = (t_us, 0.01 * label, 0.0, 0.0, 0.0, 0.0, label, 0, 0)
    head = {"t_ns": t_us * 1000, "t_recv_ns": RECEIVE_TIME_NS, "clock": Clock.BOOT}
    head |= {"system": system % 256, "component": system // 256}
    return assembler.add(fields, head)


def test_images_that_stay_incomplete_cost_their_sender_its_oldest() -> None:
    rejected: Counter[str] = Counter()
    assembler = PointAssembler(rejected)
    for t_us in range(MAX_PENDING_IMAGES + 3):
        point(assembler, 9, t_us, 0)
    assert (len(assembler), rejected["incomplete_points"]) == (MAX_PENDING_IMAGES, 3)


def test_any_number_of_senders_that_complete_nothing_costs_one_that_does_no_image() -> None:
    rejected: Counter[str] = Counter()
    assembler = PointAssembler(rejected)
    assert [point(assembler, 1, 5, k) is not None for k in range(3)] == [False, False, True]
    point(assembler, 1, 6, 0)
    for system in range(2, 2 * MAX_SENDER_COUNT + 2):
        point(assembler, system, 7, 0)
    assert len(assembler) == MAX_SENDER_COUNT + 1
    assert rejected["incomplete_points"] == MAX_SENDER_COUNT
    assert [point(assembler, 1, 6, k) is not None for k in (1, 2)] == [False, True]


def test_a_record_whose_length_is_absurd_is_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(tmp_path / "flight.mcap", monotonic=iter(range(10**6)).__next__)
    recorder.open()
    for n in range(3):
        data = random.Random(n).randbytes(1000)  # which does not get smaller in the file
        recorder.write([Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=n, data=data)])
    recorder.close()
    assert [d is None for d, _ in recording.read_recording(recorder.path)] == [False] * 3
    monkeypatch.setattr(recording, "MAX_RECORD_BYTES", 500)  # as 256 MB are of a length that was damaged
    assert [d for d, _ in recording.read_recording(recorder.path)][-1] is None


def test_images_beyond_the_room_do_not_wait() -> None:
    images = Waiting(OwnshipConfig(), {"front": None})
    ownship: Any = SimpleNamespace(now_ns=S, lead_ns=lambda t_ns: t_ns - S)
    at: Any = {"t_recv_ns": 0, "clock": Clock.BOOT, "camera": "front", "system": 0, "component": 0}
    at |= dict.fromkeys(("center", "left", "right"), (0.0, 0.0))
    taken = [
        images.takes(Exposure.of(TargetPoints(t_ns=S + S // 5 + k, target="target/1", **at)), ownship)
        for k in range(MAX_WAITING_COUNT + 10)
    ]
    assert taken == [True] * MAX_WAITING_COUNT + [False] * 10
    assert images.takes(Exposure.of(TargetPoints(t_ns=S + S // 5, target="leader", **at)), ownship), (
        "its room is its own"
    )


def fail(kind: type[Exception]) -> None:
    raise kind


def test_of_many_kinds_of_exceptions_all_are_counted_and_a_hundred_described() -> None:
    errors = Exceptions()
    for k in range(MAX_ERROR_COUNT + 20):
        kind = type(f"Error{k}", (Exception,), {})
        try:
            fail(kind)
        except kind as error:
            errors.count("decode", error)
    assert errors.counts == {"error.decode": MAX_ERROR_COUNT + 20}
    assert len(errors.lines) == MAX_ERROR_COUNT


def test_reports_beyond_the_room_are_full(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(traffic_waiting, "make_report", lambda *_: SimpleNamespace(key=("icao", 1)))
    reports = traffic_waiting.WaitingReports(TrafficConfig())
    one: Any = SimpleNamespace()
    monkeypatch.setattr(traffic_waiting, "key_of", lambda _: ("icao", 1))
    frame: Any = None
    found = [reports.add(one, frame, None, {("icao", 1)}) for _ in range(traffic_waiting.MAX_WAITING_REPORTS + 2)]
    assert found == [None] * traffic_waiting.MAX_WAITING_REPORTS + [Verdict.FULL] * 2
    assert sum(map(len, reports.take())) == traffic_waiting.MAX_WAITING_REPORTS


def test_of_the_sources_of_a_track_the_oldest_is_forgotten() -> None:
    track = Track("radar/1", None, 1, 0, {})
    for k in range(traffic_track.MAX_SOURCES_PER_TRACK + 4):
        track = track.fused(k * S, f"radar/{k}")
    assert sorted(track.sources.values()) == [k * S for k in range(4, traffic_track.MAX_SOURCES_PER_TRACK + 4)]


def test_records_beyond_the_room_before_zenoh_cost_the_oldest_and_are_counted() -> None:
    runner = zenoh.runner(Nothing())
    beyond = 300
    for n in range(2 * zenoh.PUBLISHER_CAPACITY + beyond):
        runner.put(make_estimate(n, "leader"))
    kept = waiting(runner)
    assert kept[-1].sequence == 2 * zenoh.PUBLISHER_CAPACITY + beyond - 1
    assert len(kept) + runner.health().dropped == 2 * zenoh.PUBLISHER_CAPACITY + beyond
    assert zenoh.PUBLISHER_CAPACITY <= len(kept) <= 1.5 * zenoh.PUBLISHER_CAPACITY
