"""The leader's own broadcast position in the pipeline: what it teaches, what it carries, and what is rejected."""

import itertools
import math
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.config import Config
from onboard.estimators.leader.config import BroadcastConfig
from onboard.estimators.leader.tracks.life_cycle import CARRIED, ELSEWHERE, LifeCycle
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    Cause,
    Clock,
    Estimate,
    FollowTarget,
    GlobalPosition,
    Lifecycle,
    Reason,
    TargetPoints,
)
from onboard.models.relative_motion import POSITION, SIZE
from onboard.pipeline import Pipeline
from tests.support.broadcast import LEADER_SYSTEM_ID, follow_target, leader_positions, merged, own_positions, white
from tests.support.cases import slow_but
from tests.support.streams import (
    CIRCLE,
    Item,
    Run,
    S,
    Stream,
    assert_sane,
    encode,
    feed,
    feed_once,
    make_config,
    position_error,
)
from tests.support.streams import SIZE as TRUE_SIZE

TIP_95 = 7.815  # chi-square with three degrees of freedom


def configured(*overrides: str) -> Config:
    """With a size that is 25 % too large, at a standard deviation of 30 %."""
    prior = ("size_prior_m=2.5", "size_prior_sigma_m=0.75", f"broadcast.system={LEADER_SYSTEM_ID}")
    prior = (*prior, "broadcast.trusted=true")
    return make_config(*(f"estimator.leader.{key}" for key in prior), *overrides)


def fly(
    reports: list[Item],
    t1: float,
    images: Callable[[float], bool] = lambda _t: True,
    config: Config | None = None,
    *,
    sparse: bool = True,
) -> Run:
    items = merged(Stream(t1=t1, images=images, sparse=sparse).items(), own_positions(5.0, t1), reports)
    return feed_once(encode(items), config or configured())


def counts(run: Run) -> dict[str, int]:
    """The verdicts on reports, counted."""
    verdicts = run.health.verdicts
    return {key.removeprefix("leader.broadcast_"): n for key, n in verdicts.items() if "broadcast" in key}


def inside(estimates: list[Estimate]) -> float:
    """The share whose 95 % ellipsoid holds the true position."""
    hits = []
    for e in estimates:
        off = np.array(e.mean)[POSITION] - CIRCLE.relative(e.t_ns / S)[0]
        hits.append(off @ np.linalg.solve(np.array(e.covariance)[POSITION, POSITION], off) < TIP_95)
    return float(np.mean(hits))


def between(run: Run, begin: float, end: float) -> list[Estimate]:
    """Estimates between two times on the boot clock, s."""
    return [e for e in run.estimates if begin <= e.t_ns / S < end]


def size_of(estimate: Estimate) -> tuple[float, float]:
    """The error of the size and its standard deviation, as shares of it."""
    assert estimate.mean is not None
    assert estimate.covariance is not None
    return estimate.mean[SIZE] / TRUE_SIZE - 1.0, math.sqrt(estimate.covariance[SIZE][SIZE]) / TRUE_SIZE


def test_a_broadcast_teaches_the_size_and_carries_the_track_for_20_s_seed_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The shipped filter: 25 s of images and reports that are 1 m off, then 20 s of reports alone."""
    reports = leader_positions(6.0, 52.0, error=white(1.0, 1))
    monkeypatch.setattr(BroadcastConfig, "latency_sigma_s", 0.02)
    run = fly(reports, 52.0, lambda t: not 30.0 <= t < 50.0, configured())
    error, sigma = size_of(between(run, 29.0, 30.0)[-1])
    assert abs(error) < 0.06
    assert abs(error) / 3.0 < sigma < 0.105
    blind = between(run, 32.5, 50.0)
    assert {(e.state, e.valid) for e in blind} == {(Lifecycle.COASTING, True)}
    assert all(e.reason.startswith(CARRIED) for e in blind)
    assert inside(blind) > 0.92
    assert max(position_error(e) for e in blind) < 1.5
    again = between(run, 51.0, 52.0)
    assert all(e.valid for e in again)
    assert inside(again) > 0.92
    assert abs(size_of(again[-1])[0]) < abs(error) + 0.003  # kept, though the track had been forgotten
    assert counts(run) == {"fused": 46}
    assert_sane([e for e in run.estimates if not e.reason.startswith(CARRIED)])


def test_another_systems_broadcast_is_not_used() -> None:
    run = fly(leader_positions(5.0, 9.0, system=LEADER_SYSTEM_ID + 1), 9.0)
    plain = fly([], 9.0)
    assert run.estimates == plain.estimates
    assert not counts(run)


def test_a_leader_that_no_image_shows_is_not_followed() -> None:
    run = fly(leader_positions(6.0, 9.0), 9.0, lambda _t: False)
    assert {e.state for e in run.estimates} == {Lifecycle.SEARCHING}
    assert counts(run) == {"initialising": 3}


def test_a_position_that_jumps_is_rejected_and_the_images_stand() -> None:
    """60 m to the east from 14 s on."""
    jumps = leader_positions(6.0, 20.0, error=lambda t: np.array([0.0, 60.0 * (t >= 14.0), 0.0]))
    run = fly(jumps, 20.0)
    assert counts(run) == {"fused": 8, "gated": 6}
    assert all(e.valid for e in between(run, 8.0, 20.0))
    assert inside(between(run, 12.0, 20.0)) > 0.95


def test_out_of_view_a_jump_ends_what_is_carried() -> None:
    jumps = leader_positions(5.0, 24.0, error=lambda t: np.array([0.0, 60.0 * (t >= 18.0), 0.0]))
    run = fly(jumps, 24.0, lambda t: t < 14.0)
    assert all(e.valid for e in between(run, 8.0, 21.0))
    assert not any(e.valid for e in between(run, 21.5, 24.0))
    assert inside(between(run, 8.0, 21.0)) > 0.92


def test_when_the_reports_end_so_does_what_they_carry() -> None:
    run = fly(leader_positions(6.0, 15.5), 28.0, lambda t: t < 12.0)
    assert all(e.valid for e in between(run, 8.0, 25.0))
    assert not any(e.valid for e in between(run, 25.6, 28.0))


ODD: list[tuple[dict[str, object], str]] = [
    ({"v_n": (math.nan, 0.0, 0.0)}, "not_finite"),
    ({"v_n": (0.0, math.inf, 0.0)}, "not_finite"),
    ({"alt_msl": math.nan}, "not_finite"),
    ({"alt_msl": 60_000.0}, "implausible"),
    ({"v_n": (400.0, 0.0, 0.0)}, "implausible"),
    ({"lat_deg": 0.0, "lon_deg": 0.0}, "no_position"),
    ({"lat_deg": 120.0}, "implausible"),
]


def test_a_report_that_cannot_be_used_is_counted_and_the_others_are_used() -> None:
    """All in one flight, each counted once it has come."""
    reports = [follow_target(t) for t in (6.0, *np.arange(7.0, 8.4, 0.2).tolist(), 8.6)]
    odd = [Item(i.t_recv_ns, replace(i.message, **c)) for i, (c, _) in zip(reports[1:], ODD, strict=False)]
    items = merged(Stream(t1=9.0, sparse=True).items(), own_positions(5.0, 9.0), [reports[0], *odd, reports[-1]])
    pipeline, seen, verdicts = Pipeline(configured()), Counter[str](), []
    for datagram in encode(items):
        pipeline.feed(datagram)
        now = Counter(counts(Run(pipeline, [])))
        verdicts += (now - seen).elements()
        seen = now
    assert verdicts == ["fused", *(verdict for _, verdict in ODD), "fused"]


def test_a_receiver_that_hangs_repeats_a_position_of_a_leader_that_flies() -> None:
    first, second = follow_target(6.0), follow_target(7.0)
    same = replace(first.message, t_recv_ns=second.t_recv_ns, t_ns=second.message.t_ns)
    run = fly([first, Item(second.t_recv_ns, same)], 8.0)
    assert counts(run) == {"fused": 1, "stale": 1}


def test_reports_before_our_own_position_is_known_are_counted() -> None:
    items = merged(Stream(t1=8.0, sparse=True).items(), leader_positions(5.0, 8.0))
    run = feed(encode(items), configured())
    assert counts(run) == {"no_pose": 3}


def adsb(item: Item, icao: int) -> Item:
    """The same report by ADS-B, through our own receiver."""
    m = item.message
    assert isinstance(m, GlobalPosition)
    north, east, down = m.v_F_n
    vehicle = AdsbVehicle(
        t_ns=m.t_recv_ns,
        t_recv_ns=m.t_recv_ns,
        clock=Clock.NONE,
        component=156,
        icao=icao,
        lat_deg=m.lat_deg,
        lon_deg=m.lon_deg,
        altitude=m.alt_msl,
        altitude_type=AltitudeType.GEOMETRIC,
        course=math.atan2(east, north) % (2 * math.pi),
        ground_speed=math.hypot(north, east),
        climb=-down,
    )
    return Item(item.t_recv_ns, vehicle)


def test_adsb_of_the_configured_address_is_used_and_no_other() -> None:
    config = configured("estimator.leader.broadcast.system=0", 'estimator.leader.broadcast.icao="4b1a00"')
    positions = leader_positions(6.0, 20.0)
    others = [adsb(item, 0x4B1A01) for item in leader_positions(5.5, 20.0)]
    run = fly(merged([adsb(item, 0x4B1A00) for item in positions], others), 20.0, config=config)
    assert counts(run) == {"fused": 14}
    error, sigma = size_of(run.estimates[-1])
    assert abs(error) < 2.0 * sigma < 0.55


def test_what_a_report_says_of_its_own_error_counts_if_it_is_larger() -> None:
    def sigma(position_sigma: float) -> float:
        item = follow_target(11.0)
        assert isinstance(item.message, FollowTarget)
        message = replace(item.message, position_sigma=(position_sigma,) * 3)
        return size_of(fly([Item(item.t_recv_ns, message)], 12.0).estimates[-1])[1]

    assert sigma(0.0) == sigma(1.9) < sigma(10.0)


def test_our_own_positions_error_limits_what_a_report_teaches() -> None:
    """One report, exact but for that, of a leader 28 m away. Before, the images leave the range open."""

    def sigma(own: float) -> float:
        exact = (f"estimator.leader.broadcast.{key}" for key in ("position_sigma_m=0.2", "bias_m=0.2"))
        config = configured(f"ownship.errors.position_sigma_m={own}", *exact)
        return size_of(fly([follow_target(11.4)], 12.4, config=config).estimates[-1])[1]

    assert 1.15 * sigma(0.2) < sigma(8.0)


def test_after_a_reboot_nothing_of_the_broadcast_is_left() -> None:
    run = fly(leader_positions(6.0, 9.0), 9.0, config=configured("estimator.leader.publish_rate_hz=1000"))
    estimator, ownship = run.pipeline.estimators["leader"], run.pipeline.ownship
    estimator.reset(Reason(Cause.REBOOTED, "a reboot"))
    assert not estimator.tick(ownship)[0].valid
    estimator.observe(leader_positions(8.0, 9.0)[0].message, ownship)
    ownship.receive(CIRCLE.position(9 * S), 9 * S)
    assert not estimator.tick(ownship)[0].valid


UNTRUSTED = "estimator.leader.broadcast.trusted=false"


def carried_off(speed: float, since: float) -> Callable[[float], np.ndarray]:
    """False reports, which begin gently and drift to the east."""
    return lambda t: np.array([0.0, speed * max(t - since, 0.0), 0.0])


@pytest.mark.parametrize(
    ("speed", "by"),
    slow_but([(2.0, "mavlink"), (0.5, "adsb")], itertools.product([0.5, 2.0, 15.0], ["mavlink", "adsb"])),
)
def test_out_of_view_a_false_report_leads_an_estimate_no_farther_than_2_s(speed: float, by: str) -> None:
    reports = leader_positions(6.0, 28.0, error=carried_off(speed, 13.0))
    config = configured(UNTRUSTED)
    if by == "adsb":
        reports = [adsb(item, 0x4B1A00) for item in reports]
        config = configured(
            UNTRUSTED, "estimator.leader.broadcast.system=0", 'estimator.leader.broadcast.icao="4b1a00"'
        )
    run = fly(reports, 28.0, lambda t: not 14.0 <= t < 26.0, config)
    assert not any(e.valid for e in between(run, 16.1, 26.0))
    blind = [e for e in between(run, 14.0, 16.1) if e.valid]
    assert inside(blind) > 0.92
    again = between(run, 27.0, 28.0)
    assert all(e.valid for e in again)
    assert inside(again) > 0.92


def test_a_broadcast_that_led_elsewhere_is_counted_and_named() -> None:
    """One that may be false leads nowhere: out of view it is not used."""
    reports = leader_positions(6.0, 34.0, error=carried_off(6.0, 13.0))
    for trusted in ("true", "false"):
        config = configured(f"estimator.leader.broadcast.trusted={trusted}")
        run = fly(reports, 31.0, lambda t: not 14.0 <= t < 28.0, config)
        found = counts(run)
        assert found.get("contradicted", 0) == (trusted == "true")
        assert found.get("unassociated", 0) == (0 if trusted == "true" else 14)
        assert (ELSEWHERE in run.estimates[-1].reason) is (trusted == "true")
        assert inside(between(run, 30.0, 31.0)) > 0.92


def test_a_clock_that_begins_anew_does_not_keep_a_broadcast_distrusted() -> None:
    """Only for 10 s about the time at which it led elsewhere, also for a report that comes late."""
    status = LifeCycle(configured().estimator["leader"], 3, "")
    status.started(100 * S, again=False)
    status.reported(110 * S, used=True)
    status.led_elsewhere(111 * S)
    assert status.contradictions == 1
    assert [status.was_led_elsewhere(t * S) for t in (110, 111, 120, 122, 5)] == [True, True, True, False, False]


def test_one_image_of_something_else_does_not_end_what_reports_carry() -> None:
    """Nobody sees the leader from 14 s on; at 16 s the detector takes a bird for it."""
    config, t = configured(), 16.0
    items = Stream(t1=22.0, images=lambda t: t < 14.0, sparse=True).items()
    bird = next(i for i in Stream(t0=t, t1=t + 0.2, sparse=True).items() if isinstance(i.message, TargetPoints))
    moved = {key: tuple(np.add(getattr(bird.message, key), [0.3, 0.1])) for key in ("center", "left", "right")}
    images = [Item(bird.t_recv_ns, replace(bird.message, **moved))]
    run = feed(encode(merged(items, own_positions(5.0, 22.0), leader_positions(6.0, 22.0), images)), config)
    assert not all(e.valid for e in between(run, 16.0, 17.2))
    assert all(e.valid and e.reason.startswith(CARRIED) for e in between(run, 17.5, 22.0))
    assert inside(between(run, 17.5, 22.0)) > 0.92


def test_a_false_report_teaches_no_size_beyond_what_was_configured() -> None:
    """Seen all the way; reports that recede by 0.5 m/s. The size that was configured is right to 5 %."""
    north = lambda t: 0.5 * max(t - 8.0, 0.0) * CIRCLE.relative(t)[0] / 28.0  # noqa: E731
    config = configured(UNTRUSTED, "estimator.leader.size_prior_m=2.0", "estimator.leader.size_prior_sigma_m=0.1")
    run = fly(leader_positions(6.0, 40.0, error=north), 40.0, config=config)
    assert all(abs(size_of(e)[0]) < 0.16 for e in between(run, 8.0, 40.0))
