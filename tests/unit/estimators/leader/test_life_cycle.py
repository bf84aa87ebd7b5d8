"""The life cycle of a track: by hand, and in flights its states, their times, and when it is valid."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import belief
from onboard.estimators.leader.tracks.life_cycle import Facts, LifeCycle
from onboard.messages import Datagram, Lifecycle, TargetPoints, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S
from tests.support.streams import (
    CIRCLE,
    LATENCY,
    MS,
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


def life_cycle() -> LifeCycle:
    """A track that has just started, at 10 s; it ends when the gate stops all images for a second."""
    made = LifeCycle(Config(), 3, Reason(Cause.STARTING, ""))
    made.started(10 * NS_PER_S, again=False)
    return made


def gated(one: LifeCycle, t: float) -> bool:
    """Whether a track must end when the gate stops an image of this time, s."""
    return one.judge(round(t * NS_PER_S), passes=False, has_extent=True, newest_ns=None).is_over


def test_a_track_ends_when_nothing_has_passed_the_gate_for_too_long() -> None:
    one = life_cycle()
    times = [11.0, 11.5, 12.0, 12.1]
    assert [gated(one, t) for t in times] == [False, False, False, True]


def test_an_image_that_passes_begins_that_time_anew() -> None:
    one = life_cycle()
    assert not gated(one, 11.0)
    assert not one.judge(round(11.5 * NS_PER_S), passes=True, has_extent=True, newest_ns=None).is_late
    assert one.judge(round(11.4 * NS_PER_S), passes=True, has_extent=True, newest_ns=None).is_late
    assert not gated(one, 12.5)
    assert not gated(one, 13.4)
    assert gated(one, 13.6)


def test_an_image_that_passes_when_judged_again_does_so_too() -> None:
    one = life_cycle()
    assert not gated(one, 11.0)
    one.judged_again(round(11.5 * NS_PER_S))
    assert not gated(one, 12.5)
    assert one.last_fused_ns == round(11.5 * NS_PER_S)


# When the newest image was fused (s before), what else is so; state and cause. The first line that holds decides.
CASES = [
    ("an image was fused just now", 0.1, {}, "tracking", Cause.FUSED),
    ("none for a moment", 1.0, {}, "coasting", Cause.PREDICTED),
    ("none within the validity timeout", 3.0, {}, "lost", Cause.TIMEOUT),
    ("something contradicts it", 0.1, {"doubt": Reason(Cause.LEAPT, "leapt")}, "lost", Cause.LEAPT),
    ("it contradicts it when lost, too", 3.0, {"doubt": Reason(Cause.LEAPT, "leapt")}, "lost", Cause.LEAPT),
    ("its heading is open", 0.1, {"question": "open"}, "tracking", Cause.FUSED),
]


@pytest.mark.parametrize(("age_s", "facts", "state", "cause"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
def test_what_decides_the_state(age_s: float, facts: dict[str, Any], state: str, cause: Cause) -> None:
    given = {"doubt": None, "in_view": True, "finding": "", "question": ""} | facts
    found, why = life_cycle().state(round((10.0 + age_s) * NS_PER_S), Facts(**given))
    assert (found.value, why.cause) == (state, cause)


def test_what_is_found_is_told_always_and_what_is_open_while_it_is_followed() -> None:
    one = life_cycle()
    reasons = [
        one.state(round(t * NS_PER_S), Facts(None, in_view=False, finding="noisy", question="open"))[1].words
        for t in (10.0, 11.0, 13.0)
    ]
    outside = ", and it should be outside the view"
    assert reasons == [
        "images fused; noisy; open",
        f"no image fused lately: predicted{outside}; noisy; open",
        f"no image fused within the validity timeout{outside}; noisy",
    ]


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


def test_gated_images_do_not_prolong_validity_draws_1_to_4(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 24 draws of wrong images one, at most, has three in which an aircraft may have been."""
    monkeypatch.setattr(Config, "relock_after_s", 60.0)
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

    run = feed(encode(wrong(i) for i in Stream(t1=11.0).items()), make_config())
    assert_sane(run.estimates)
    assert run.verdicts()[Verdict.GATED] + run.verdicts()[Verdict.INITIALISING] > 90
    return any(e.valid for e in run.estimates if e.t_ns > (7.05 + VALID) * S)


def jumping(gap_after: float = 45.0) -> list[Datagram]:
    """From t = 8 s on the images show another aircraft, elsewhere."""
    near, far = Flight(radius=None, gap=20.0), Flight(radius=None, gap=gap_after)
    items = [i for i in Stream(flight=near, t1=12.0).items() if i.message.t_ns < 8 * S]
    items += [i for i in Stream(flight=far, t1=12.0).items() if i.message.t_ns >= 8 * S]
    return encode(sorted(items, key=lambda i: i.t_recv_ns))


def test_a_track_whose_images_are_all_gated_ends_and_starts_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Config, "reset_timeout_s", 3.0)
    run = feed(jumping(), make_config())
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
