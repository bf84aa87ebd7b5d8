"""The life cycle of a track: its states, their times, and when it is valid."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.hypotheses import belief
from onboard.estimators.leader.tracks.doubts import Checks
from onboard.messages import Cause, Datagram, Lifecycle, Reason, TargetPoints, Verdict
from tests.support.streams import (
    CIRCLE,
    EPOCH,
    LATENCY,
    MS,
    STRAIGHT,
    Flight,
    Item,
    Run,
    S,
    Stream,
    assert_sane,
    encode,
    feed,
    make_config,
    position_error,
)

COAST, VALID, RESET, RELOCK = 0.25, 2.0, 10.0, 1.0


SLACK = 0.1  # s: latency and sample spacing


def fly(images: Callable[[float], bool], t1: float, flight: Flight = CIRCLE, *overrides: str) -> Run:
    run = feed(Stream(flight=flight, t1=t1, images=images).datagrams(), make_config(*overrides))
    assert_sane(run.estimates)
    return run


def phases(run: Run) -> list[tuple[Lifecycle, float]]:
    """(state, when it began in boot seconds), in order."""
    found: list[tuple[Lifecycle, float]] = []
    for e in run.estimates:
        if not found or e.state is not found[-1][0]:
            found.append((e.state, e.t_ns / S))
    return found


def test_a_track_starts_coasts_is_lost_forgotten_and_starts_again_at_the_right_times() -> None:
    run = fly(lambda t: 6.0 <= t <= 8.0 or t >= 20.0, 22.0)
    states, times = zip(*phases(run), strict=True)
    assert states == (
        Lifecycle.SEARCHING,
        Lifecycle.INITIALISING,
        Lifecycle.TRACKING,
        Lifecycle.COASTING,
        Lifecycle.LOST,
        Lifecycle.SEARCHING,
        Lifecycle.INITIALISING,
        Lifecycle.TRACKING,
    )
    three = 6.0 + 0.08 + LATENCY / S
    expected = (5.0, 6.0, three, 8.0 + COAST, 8.0 + VALID, 8.0 + RESET, 20.0, 20.14)
    assert times == pytest.approx(expected, abs=SLACK)
    assert run.estimates[-1].reset_count == 1
    assert position_error(run.estimates[-1]) < 2.5  # 0.7 to 2.3 m over twelve draws


@pytest.mark.parametrize(("key", "value", "index"), [("coast_after_s", 0.5, 3), ("validity_timeout_s", 1.2, 4)])
def test_the_timeouts_are_those_configured(key: str, value: float, index: int) -> None:
    run = fly(lambda t: 6.0 <= t <= 8.0, 11.0, CIRCLE, f"estimator.leader.{key}={value}")
    assert phases(run)[index][1] == pytest.approx(8.0 + value, abs=SLACK)


def test_the_reset_timeout_is_the_one_configured() -> None:
    run = fly(lambda t: 6.0 <= t <= 8.0, 13.0, CIRCLE, "estimator.leader.reset_timeout_s=4")
    assert phases(run)[-1] == (Lifecycle.SEARCHING, pytest.approx(12.0, abs=SLACK))
    assert run.estimates[-1].mean is None
    assert run.estimates[-1].age is None
    assert "reset timeout" in run.estimates[-1].reason


def test_never_valid_for_longer_than_the_timeout_after_the_last_image_while_ticks_go_on() -> None:
    run = fly(lambda t: t <= 7.0, 16.0, CIRCLE, "estimator.leader.publish_rate_hz=1000")
    after = [e for e in run.estimates if e.t_ns > (7.0 + VALID) * S]
    assert len(after) > 300
    assert not any(e.valid for e in after)
    before = [e for e in run.estimates if 6 * S < e.t_ns < (7.0 + VALID) * S - 50 * MS]
    assert all(e.valid for e in before)
    for e in run.estimates:
        assert e.valid == (e.state in (Lifecycle.TRACKING, Lifecycle.COASTING))


def test_a_lost_track_is_valid_again_only_after_three_images(monkeypatch: pytest.MonkeyPatch) -> None:
    """One image at 10.4 s, four seconds after the last, makes no track valid; three from 11 s on do. By then the
    leader could be so far away that the track starts anew, with what is known of its motion."""
    known = belief.leader_model
    monkeypatch.setattr(belief, "leader_model", lambda config: known(config)._replace(velocity_random_walk=2.0))
    run = fly(lambda t: t <= 6.4 or 10.39 <= t <= 10.41 or t >= 11.0, 11.5, CIRCLE)
    late = [e for e in run.estimates if e.measurement and e.measurement.t_ns > 7 * S]
    held = [Verdict.INITIALISING] * 4
    assert [e.measurement.verdict for e in late if e.measurement][:5] == [*held, Verdict.FUSED]
    assert [e.valid for e in late[:5]] == [False, False, False, True, True]
    assert not any(e.valid for e in run.estimates if 8.5 * S < e.t_ns < 11.0 * S)
    assert run.estimates[-1].reset_count == 1
    last = run.estimates[-1]
    assert last.covariance is not None
    sigma = math.sqrt(max(np.linalg.eigvalsh(np.array(last.covariance)[:3, :3])))
    assert position_error(last) < min(3.0 * sigma, 15.5)  # half a second after its start it is not sharp yet


def test_gated_images_do_not_prolong_validity_draws_1_to_4() -> None:
    """Of 24 draws of wrong images one, at most, has three in which an aircraft may have been."""
    assert sum(map(_valid_on_wrong_images, range(1, 5))) <= 1


def _valid_on_wrong_images(draw: int) -> bool:
    def wrong(item: Item) -> Item:
        m = item.message
        if isinstance(m, TargetPoints) and m.t_ns > 7 * S:
            # somewhere else in each image: no two of them agree
            rng = np.random.default_rng([m.t_ns // MS, draw])
            at = rng.uniform(0.2, 0.4, 2) * rng.choice([-1, 1], 2)
            p = [(float(at[0] + d), float(at[1])) for d in (0, -0.03, 0.03)]
            m = replace(m, center=p[0], left=p[1], right=p[2])
        return Item(item.t_recv_ns, m)

    config = make_config("estimator.leader.relock_after_s=60")
    run = feed(encode(wrong(i) for i in Stream(t1=11.0).items()), config)
    assert_sane(run.estimates)
    assert run.verdicts()[Verdict.GATED] + run.verdicts()[Verdict.INITIALISING] > 90
    return any(e.valid for e in run.estimates if e.t_ns > (7.05 + VALID) * S)


def jumping(gap_after: float = 45.0) -> list[Datagram]:
    """From t = 8 s on the images show another aircraft, elsewhere."""
    near, far = Flight(radius=None, gap=20.0), Flight(radius=None, gap=gap_after)
    items = [i for i in Stream(flight=near, t1=12.0).items() if i.message.t_ns < 8 * S]
    items += [i for i in Stream(flight=far, t1=12.0).items() if i.message.t_ns >= 8 * S]
    return encode(sorted(items, key=lambda i: i.t_recv_ns))


def test_a_track_whose_images_are_all_gated_ends_and_starts_anew() -> None:
    run = feed(jumping(), make_config("estimator.leader.reset_timeout_s=3"))
    assert_sane(run.estimates)
    gated = [r for r in run.reports if r.verdict is Verdict.GATED]
    assert gated[0].t_ns >= 8 * S
    assert gated[-1].t_ns == pytest.approx(8 * S + RELOCK * S, abs=SLACK * S)
    last = run.estimates[-1]
    assert last.reset_count == 1
    assert last.valid
    assert position_error(last, Flight(radius=None, gap=45.0)) < 4.5
    in_question = [e for e in run.estimates if 9.2 * S < e.t_ns < 10.9 * S]
    assert {(e.state, e.valid, e.reason) for e in in_question} == {
        (Lifecycle.LOST, False, "the images leapt: another object may have taken its place")
    }


def test_one_good_image_among_gated_ones_keeps_the_track() -> None:
    def sometimes(item: Item) -> Item:
        m = item.message
        if isinstance(m, TargetPoints) and m.t_ns > 7 * S and m.t_ns % (600 * MS) != 0:
            m = replace(m, center=(0.4, 0.3), left=(0.37, 0.3), right=(0.43, 0.3))
        return Item(item.t_recv_ns, m)

    run = feed(encode(sometimes(i) for i in Stream(flight=STRAIGHT, t1=12.0).items()))
    assert_sane(run.estimates)
    assert run.verdicts()[Verdict.GATED] > 80
    assert run.estimates[-1].reset_count == 0
    assert position_error(run.estimates[-1], STRAIGHT) < 2.8


def test_images_that_do_not_agree_start_no_track() -> None:
    def scattered(item: Item) -> Item:
        m = item.message
        if isinstance(m, TargetPoints):
            at = 0.3 if m.t_ns // (40 * MS) % 2 else -0.3
            m = replace(m, center=(at, 0.0), left=(at - 0.03, 0.0), right=(at + 0.03, 0.0))
        return Item(item.t_recv_ns, m)

    run = feed(encode(scattered(i) for i in Stream(t1=8.0).items()))
    assert not any(e.valid for e in run.estimates)
    assert set(run.verdicts()) == {Verdict.INITIALISING}


def test_images_far_apart_in_time_start_no_track() -> None:
    run = fly(lambda t: round(t * 1000) % 1200 == 0, 12.0)
    assert not any(e.valid for e in run.estimates)


def test_a_reboot_of_the_autopilot_in_flight_starts_everything_anew() -> None:
    before = Stream(t0=60.0, t1=63.0).items()
    after = [Item(i.t_recv_ns + 61 * S, i.message) for i in Stream(t0=3.0, t1=6.0).items()]
    run = feed(encode([*before, *after]))
    assert_sane(run.estimates)
    health = run.pipeline.health(EPOCH + 67 * S)
    assert health.autopilot_reboots == 1
    assert health.rejected["odd_stamp"] == 4
    last = run.estimates[-1]
    assert last.reset_count == 1
    assert last.valid
    assert last.t_ns == 5_980 * MS
    assert position_error(last) < 2.0
    resumed = next(e for e in run.estimates if e.t_ns < 10 * S)
    assert not resumed.valid


def test_images_that_waited_when_the_autopilot_rebooted_are_forgotten() -> None:
    before = Stream(t0=60.0, t1=61.0, lead_ns=900 * MS).items()
    after = [
        Item(i.t_recv_ns + 56 * S, i.message) for i in Stream(t0=6.0, t1=66.0, images=lambda _t: False).items()
    ]
    run = feed(encode([*before, *after]))
    assert run.pipeline.clocks.reboots == 1
    rebooted = next(i for i, e in enumerate(run.estimates) if e.t_ns < 10 * S)
    assert all(e.measurement is None for e in run.estimates[rebooted:])


def test_what_a_check_contradicts_is_not_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Checks, "judge", lambda *_: (Reason(Cause.NOISE, "contradicted"), ""))
    last = fly(lambda t: t >= 6.0, 6.6, CIRCLE).estimates[-1]
    assert last.mean is not None
    assert (last.valid, last.cause, last.reason) == (False, Cause.NOISE, "contradicted")
