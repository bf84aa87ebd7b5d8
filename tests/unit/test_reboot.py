"""When the autopilot has rebooted, no estimator keeps what it believed: its clock and its origin are new."""

from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from onboard.config import parse_config
from onboard.messages import Cause, Estimate, Lifecycle, Message, NavState, Reason, TargetPoints
from onboard.pipeline import Pipeline
from tests.support import own_vehicle as own
from tests.support.images import exposed
from tests.support.streams import S, Stream, heartbeat
from tests.support.traffic import Sky, fly_with_reports

LEADER = {"size_prior_m": 2.0}


def rebooted(
    name: str, section: dict[str, object], before: Sequence[Message], after: Sequence[Message]
) -> Pipeline:
    """A pipeline with one estimator, flown before and after a reboot."""
    pipeline = Pipeline(parse_config({"estimator": {name: section}}))
    published = estimates(pipeline.advance(exposed(before)))
    assert published[-1].valid
    pipeline.advance(exposed(after))
    assert pipeline.clocks.reboots == 1
    return pipeline


def estimates(outputs: Sequence[object]) -> list[Estimate]:
    return [o for o in outputs if isinstance(o, Estimate)]


def own_motion(start_s: float, end_s: float, host_s: float) -> list[Message]:
    """Attitude and position from a boot time on, without images, received `host_s` later."""
    items = Stream(t0=start_s, t1=end_s, images=lambda _: False).items()
    return [moved(item.message, host_s) for item in items]


def moved(message: Message, host_s: float) -> Message:
    return replace(message, t_recv_ns=message.t_recv_ns + round(host_s * S))


def test_a_leader_is_searched_for_anew_seed_1() -> None:
    before = [heartbeat(5 * S), *(item.message for item in Stream(t1=8.0).items())]
    pipeline = rebooted("leader", LEADER, before, own_motion(1.0, 1.3, 60.0))
    published = estimates(pipeline.advance(own_motion(1.3, 1.5, 60.0)))
    assert {(e.state, e.valid, e.mean, e.reset_count) for e in published} == {
        (Lifecycle.SEARCHING, False, None, 1)
    }
    assert {(e.cause, e.reason) for e in published} == {(Cause.REBOOTED, "the autopilot has rebooted")}


def test_our_own_state_waits_for_a_fix_again() -> None:
    before = [own.heartbeat(), *own.hovering(10_000, 14_000)]
    after = [m for m in own.hovering(1000, 1400) if not hasattr(m, "fix_type")]
    late = [moved(m, 30.0) for m in after]
    pipeline = rebooted("own_state", {}, before, late)
    more = [moved(m, 30.0) for m in own.hovering(1400, 1600) if not hasattr(m, "fix_type")]
    published = [o for o in pipeline.advance(more) if isinstance(o, NavState)]
    assert published
    assert {(s.state, s.valid, s.mean, s.reset_count) for s in published} == {
        (Lifecycle.SEARCHING, False, None, 1)
    }


@pytest.mark.parametrize("filter_", ["imm", "ekf"])
def test_traffic_is_forgotten_with_our_own_place(filter_: str) -> None:
    sky = Sky(filter=filter_)
    fly_with_reports(sky, 4)
    assert sky.published[-1].valid
    sky.estimator.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))
    published = sky.estimator.tick(sky.ownship)
    assert [(e.valid, e.mean, e.reason) for e in published] == [(False, None, "the autopilot has rebooted")]
    assert sky.estimator.tick(sky.ownship) == []
    report = sky.adsb((2000.0, 0.0, -100.0), (-30.0, 0.0, 0.0))
    sky.estimator.observe(report, sky.ownship)
    assert sky.verdicts["no_pose"] == 1  # where we are is not known any more


def test_reports_that_wait_at_a_reboot_are_dropped() -> None:
    """They are of a clock that is no longer ours."""
    sky = Sky()
    fly_with_reports(sky, 4)
    sky.receive(sky.adsb((2000.0, 0.0, -100.0), (-30.0, 0.0, 0.0), icao=0xABC001))
    sky.estimator.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))
    sky.fly(1.0)
    assert sky.estimator._tracker.tracks == []


def test_every_estimator_of_the_pipeline_is_told_of_the_reboot_seed_1() -> None:
    everything = {"leader": LEADER, "own_state": {}, "traffic": {}}
    pipeline = Pipeline(parse_config({"estimator": everything}))
    reasons: dict[str, list[Reason]] = {name: [] for name in everything}
    for name, estimator in pipeline.estimators.items():
        reset = estimator.reset

        def noted(why: Reason, name: str = name, reset: object = reset) -> None:
            reasons[name].append(why)
            reset(why)  # type: ignore[operator]

        estimator.reset = noted
    pipeline.advance([heartbeat(5 * S), *own_motion(5.0, 6.0, 0.0), *own_motion(1.0, 1.3, 60.0)])
    assert reasons == {name: [Reason(Cause.REBOOTED, "the autopilot has rebooted")] for name in everything}
    assert pipeline.ownship.now_ns < 2 * S


def test_images_that_wait_at_a_reboot_are_dropped_seed_1() -> None:
    pipeline = Pipeline(parse_config({"estimator": {"leader": LEADER}}))
    stream = [item.message for item in Stream(t1=6.0).items()]
    image = next(m for m in stream if isinstance(m, TargetPoints))
    ahead = replace(image, t_ns=round(6.4 * S))
    pipeline.advance(exposed([heartbeat(5 * S), *stream, ahead]))
    assert len(pipeline._waiting) == 1
    pipeline.advance(own_motion(1.0, 1.3, 60.0))
    assert len(pipeline._waiting) == 0
