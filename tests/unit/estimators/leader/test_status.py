"""The life cycle of a track by hand: what the gate lets pass, and what it stops."""

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.tracks.status import Status
from onboard.geometry.units import NS_PER_S


def status() -> Status:
    """A track that has just started, at 10 s; it ends when the gate stops all images for a second."""
    made = Status(Config(relock_after_s=1.0), 3, "")
    made.started(10 * NS_PER_S, again=False)
    return made


def test_a_track_ends_when_nothing_has_passed_the_gate_for_too_long() -> None:
    one = status()
    times = [11.0, 11.5, 12.0, 12.1]
    assert [one.gated(round(t * NS_PER_S)) for t in times] == [False, False, False, True]


def test_an_image_that_passes_begins_that_time_anew() -> None:
    one = status()
    assert not one.gated(11 * NS_PER_S)
    one.fused(round(11.5 * NS_PER_S), was_lost=False, has_wing=True)
    assert not one.gated(round(12.5 * NS_PER_S))
    assert not one.gated(round(13.4 * NS_PER_S))
    assert one.gated(round(13.6 * NS_PER_S))


def test_an_image_that_passes_when_judged_again_does_so_too() -> None:
    one = status()
    assert not one.gated(11 * NS_PER_S)
    one.judged_again(round(11.5 * NS_PER_S))
    assert not one.gated(round(12.5 * NS_PER_S))
    assert one.last_fused_ns == round(11.5 * NS_PER_S)
