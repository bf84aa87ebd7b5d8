"""The leader estimator in the pipeline: images ahead of the clock, messages of other systems, and the health."""

import pytest
from msgspec.structs import replace

from onboard.messages import Clock, Datagram, Encoding, Estimate, Lifecycle, TargetPoints, Verdict
from onboard.pipeline import Pipeline
from tests.support.images import exposed
from tests.support.streams import (
    CIRCLE,
    EPOCH,
    MS,
    Item,
    S,
    Stream,
    assert_sane,
    encode,
    feed,
    heartbeat,
    make_config,
)

# ---------------------------------------------------------------------- images ahead of the boot clock


def test_images_half_a_second_ahead_wait_and_are_fused() -> None:
    """In a log that another program has put together: live, they are refused (`test_other_clocks`)."""
    run = feed(encode(Stream(t1=12.0, lead_ns=500 * MS).items(), "tlog"))
    assert_sane(run.estimates)
    assert set(run.verdicts()) <= {Verdict.INITIALISING, Verdict.FUSED, Verdict.FUSED_LATE}
    assert run.verdicts()[Verdict.FUSED] > 150
    assert run.estimates[-1].valid
    assert run.pipeline.health(0).clock_offset_ns == EPOCH + 2 * MS
    fused = [e for e in run.estimates if e.measurement is not None]
    assert all(e.measurement is None or e.measurement.t_ns <= e.t_ns for e in fused)


def test_the_waiting_room_is_bounded() -> None:
    pipeline = Pipeline(make_config())
    pipeline.advance([heartbeat(5 * S), CIRCLE.attitude(5 * S), CIRCLE.position(5 * S)])
    for i in range(600):
        pipeline.advance(exposed([replace(CIRCLE.image(5 * S), t_ns=5 * S + 200 * MS + i)]))
    assert len(pipeline._waiting) <= 256
    outputs = pipeline.advance([CIRCLE.attitude(6 * S), CIRCLE.position(6 * S)])
    assert len(pipeline._waiting) == 0
    assert sum(isinstance(o, Estimate) and o.measurement is not None for o in outputs) == 256


# ------------------------------------------------------------------------- messages of other systems


def test_images_without_a_stamp_are_counted() -> None:
    items = [
        Item(
            i.t_recv_ns,
            replace(i.message, t_ns=0, clock=Clock.NONE) if isinstance(i.message, TargetPoints) else i[1],
        )
        for i in Stream(t1=6.0).items()
    ]
    run = feed(encode(items))
    assert run.reports == []
    assert run.rejected == {"unstamped_points": 25}


def test_another_target_has_a_track_of_its_own() -> None:
    items = [
        Item(i.t_recv_ns, replace(i.message, target="target/1") if isinstance(i.message, TargetPoints) else i[1])
        for i in Stream(t1=6.0).items()
    ]
    run = feed(encode(items))
    last = {e.target: e for e in run.estimates}
    assert last["leader"].state is Lifecycle.SEARCHING
    assert last["target/1"].state is Lifecycle.TRACKING
    assert run.pipeline.health(EPOCH + 6 * S).states == {
        "leader": Lifecycle.SEARCHING,
        "leader.target/1": Lifecycle.TRACKING,
    }


# -------------------------------------------------------------------------------------------- health


def test_health_counts_streams_verdicts_and_states() -> None:
    stream = Stream(t1=9.0)
    run = feed([*stream.datagrams(), Datagram(channel="z", encoding=Encoding.POINTS, t_recv_ns=EPOCH, data=b"{")])
    health = run.pipeline.health(EPOCH + 9 * S)
    assert health.streams["Attitude"].count == 200
    assert health.streams["Attitude"].rate == pytest.approx(50, abs=1)
    assert health.streams["Exposure"].rate == pytest.approx(25, abs=1)
    assert health.streams["Exposure"].age == pytest.approx(0.0, abs=0.06)
    assert health.states == {"leader": Lifecycle.TRACKING}
    assert health.verdicts == {f"leader.{k}": n for k, n in run.verdicts().items()}
    assert health.rejected == {"bad_points": 1}
    assert health.autopilot == "PX4, system 1"
    assert health.uptime == pytest.approx(4.0, abs=0.1)
