"""The leader estimator in the pipeline: images ahead of the clock, messages of other systems, and the health."""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import Clock, Datagram, Encoding, Estimate, Lifecycle, TargetPoints, Verdict
from onboard.pipeline import Pipeline
from tests.support.cases import slow_but
from tests.support.images import exposed
from tests.support.streams import (
    CIRCLE,
    EPOCH,
    MS,
    Item,
    S,
    Stream,
    advance,
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


def test_images_farther_ahead_than_allowed_are_rejected_with_a_verdict_and_counted() -> None:
    run = feed(encode(Stream(t1=8.0, lead_ns=1500 * MS).items(), "tlog"))
    assert set(run.verdicts()) == {Verdict.TOO_NEW}
    health = run.pipeline.health(EPOCH + 8 * S)
    assert health.verdicts["leader.too_new"] == run.verdicts()[Verdict.TOO_NEW] > 60
    assert health.autopilot_reboots == 0
    assert not health.rejected
    assert run.estimates[-1].state is Lifecycle.SEARCHING


def test_a_camera_far_ahead_does_not_disturb_one_that_is_right() -> None:
    items = Stream(t1=12.0).items()
    ahead = [
        Item(i.t_recv_ns + 1, replace(i.message, t_ns=i.message.t_ns + 3 * S, component=100))
        for i in items
        if isinstance(i.message, TargetPoints)
    ]
    run = feed(encode(sorted([*items, *ahead], key=lambda i: i.t_recv_ns)))
    plain = feed(encode(items))
    assert run.estimates[-1].mean == plain.estimates[-1].mean
    assert run.verdicts()[Verdict.TOO_NEW] + run.rejected["later_than_arrival"] == len(ahead)


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


def test_nothing_is_estimated_before_an_autopilot_is_heard() -> None:
    items = [i for i in Stream(t1=6.0).items() if type(i.message).__name__ != "Heartbeat"]
    run = feed(encode(items))
    assert run.outputs == []
    assert run.rejected == {"before_heartbeat": len(items)}


def test_heartbeats_that_are_no_autopilots_are_not_latched() -> None:
    pipeline = Pipeline(make_config())
    pipeline.advance([heartbeat(5 * S, system=255, autopilot=8)])
    assert pipeline.autopilot is None
    pipeline.advance([heartbeat(5 * S, system=7), heartbeat(5 * S, system=9)])
    assert pipeline.autopilot is not None
    assert pipeline.autopilot.system == 7


def test_a_configured_system_is_waited_for() -> None:
    pipeline = Pipeline(make_config("autopilot.system=9"))
    pipeline.advance([heartbeat(5 * S, system=7)])
    assert pipeline.autopilot is None
    pipeline.advance([heartbeat(5 * S, system=9)])
    assert pipeline.autopilot is not None


def test_another_components_motion_and_clock_are_not_ours() -> None:
    """A gimbal that sends its own ATTITUDE, on its own boot clock, in the same system."""
    items = Stream(t1=9.0).items()
    gimbal = [
        Item(
            i.t_recv_ns + 1,
            replace(i.message, t_ns=i.message.t_ns - 2 * S, q_nb=(0.0, 1.0, 0.0, 0.0), component=154),
        )
        for i in items
        if type(i.message).__name__ == "Attitude"
    ]
    run = feed(encode(sorted([*items, *gimbal], key=lambda i: i.t_recv_ns)))
    assert run.estimates[-1].mean == feed(encode(items)).estimates[-1].mean
    assert run.rejected == {"other_component": len(gimbal)}


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


def test_rates_stay_true_and_windows_small_when_our_clock_is_set_back() -> None:
    items = Stream(t1=9.0).items()
    back = [Item(i.t_recv_ns - 86_400 * S, i.message) for i in Stream(t0=9.0, t1=15.0).items()]
    run = feed(encode([*items, *back]))
    health = run.pipeline.health(EPOCH + 15 * S - 86_400 * S)
    assert health.streams["Attitude"].rate == pytest.approx(50, abs=1)
    assert all(len(stream._window) < 120 for stream in run.pipeline._monitor._streams.values())


@pytest.mark.parametrize("horizon", slow_but([0.02], [0.0, 0.02, 0.1]))
def test_a_short_horizon_with_images_ahead_of_our_motion_does_no_harm_seed_7(horizon: float) -> None:
    rng = np.random.default_rng(7)
    images = [Item(EPOCH + t * MS, CIRCLE.image(t * MS + 25 * MS, rng)) for t in range(5100, 8500, 20)]
    items = Stream(t1=9.0, images=lambda _t: False).items()
    messages = [i.message for i in sorted([*items, *images], key=lambda i: i.t_recv_ns)]
    run = advance(messages, make_config(f"estimator.leader.rewind_horizon_s={horizon}"))
    assert_sane(run.estimates)
    assert run.estimates[-1].valid
