"""The life cycle of a track by hand: what the gate lets pass, and what it stops."""

from typing import Any

import pytest

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.tracks.life_cycle import Facts, LifeCycle
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S


def life_cycle() -> LifeCycle:
    """A track that has just started, at 10 s; it ends when the gate stops all images for a second."""
    made = LifeCycle(Config(relock_after_s=1.0), 3, Reason(Cause.STARTING, ""))
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
