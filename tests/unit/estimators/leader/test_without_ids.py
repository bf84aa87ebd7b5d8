"""Images without ids (`"target": ""`): as many tracks as there are aircraft, whatever the noise does."""

import itertools
from collections import Counter

import pytest
from msgspec.structs import replace

from onboard.messages import Estimate, Message, TargetPoints
from onboard.messages.causes import Cause
from tests.support.cases import slow_but
from tests.support.streams import CIRCLE, Flight, S, Stream, advance

STRAIGHT, TIGHT = Flight(radius=None, gap=25.0), Flight(radius=60.0, gap=15.0)
SIDE = 0.15  # rad


def unnamed(flight: Flight, seed: int, t1: float, *, sparse: bool = True) -> list[Message]:
    messages = (i.message for i in Stream(flight=flight, t1=t1, seed=seed, sparse=sparse).items())
    return [replace(m, target="") if isinstance(m, TargetPoints) else m for m in messages]


def fused(messages: list[Message]) -> Counter[str]:
    """Images fused by target."""
    estimates = advance(messages).estimates
    return Counter(e.target for e in estimates if e.measurement and e.measurement.verdict.startswith("fused"))


def one_track(flight: Flight, seed: int, seconds: float) -> None:
    messages = unnamed(flight, seed, 5.0 + seconds)
    found = fused(messages)
    assert set(found) == {"leader"}
    assert found["leader"] > 0.97 * sum(isinstance(m, TargetPoints) for m in messages)


@pytest.mark.parametrize(
    ("flight", "seed"), [(CIRCLE, 1), (STRAIGHT, 1), (TIGHT, 3)], ids=["1", "straight-1", "tight-3"]
)
def test_one_aircraft_without_an_id_is_one_track_seeds_1_and_3(flight: Flight, seed: int) -> None:
    one_track(flight, seed, 10.0)


@pytest.mark.parametrize(
    ("first", "leader_id"),
    slow_but([(True, ""), (False, "leader")], itertools.product([True, False], ["", "leader"])),
)
def test_two_aircraft_are_two_tracks_seed_2(first: bool, leader_id: str) -> None:
    messages: list[Message] = []
    for m in unnamed(CIRCLE, 2, 12.0, sparse=False):
        messages.append(m)
        if isinstance(m, TargetPoints) and m.t_ns > 8 * S:
            center, left, right = ((u + SIDE, v) for u, v in (m.center, m.left, m.right))
            other = replace(m, center=center, left=left, right=right)
            messages[-1] = replace(m, target=leader_id)
            messages.insert(len(messages) - first, other)
    found = fused(messages)
    assert set(found) == {"leader", "unnamed/1"}
    images = sum(isinstance(m, TargetPoints) and m.t_ns > 8 * S for m in messages) / 2
    assert found["unnamed/1"] > 0.95 * images


def test_a_leader_that_two_cameras_show_apart_is_said_to_be_seed_3() -> None:
    """By one id: no image agrees with that of the other camera, and "1 of 3 images" was all that was said."""
    messages = list[Message]()
    for m in unnamed(STRAIGHT, 3, 8.0):
        if not isinstance(m, TargetPoints):
            messages.append(m)
            continue
        one = replace(m, target="leader")
        center, left, right = ((u + 0.21, v) for u, v in (m.center, m.left, m.right))
        other = replace(one, camera="right", t_ns=m.t_ns + 10_000_000, center=center, left=left, right=right)
        messages += [one, other]
    last = advance(messages).estimates[-1]
    assert (last.valid, last.cause) == (False, Cause.CAMERAS_APART)
    assert "and right show it 12 degrees apart, and one 1." in last.reason


@pytest.mark.parametrize(
    ("stays", "leader_id"),  # goes, or stays, but is not valid
    slow_but([(False, "leader"), (True, "")], itertools.product([False, True], ["", "leader"])),
)
def test_the_name_passes_on_from_what_was_seen_first_unless_images_name_it_seed_1(
    stays: bool, leader_id: str
) -> None:
    """What was seen first has no wing any more: its track is not valid, whether it is still seen or not."""
    messages: list[Message] = []
    for m in unnamed(STRAIGHT, 1, 22.0):
        if not isinstance(m, TargetPoints):
            messages.append(m)
            continue
        center, left, right = ((u + SIDE, v) for u, v in (m.center, m.left, m.right))
        if m.t_ns < 8 * S:
            messages.append(replace(m, target=leader_id))
        elif stays:
            messages.append(replace(m, target=leader_id, left=m.center, right=m.center))
        messages.append(replace(m, center=center, left=left, right=right))
    estimates = [e for e in advance(messages).estimates if isinstance(e, Estimate) and e.t_ns > 20 * S]
    by_target = {e.target: e for e in estimates}
    assert by_target["leader"].valid is (leader_id == "")
    assert ("unnamed/1" in by_target and by_target["unnamed/1"].valid) is (leader_id == "leader")
    counts = [(e.sequence, e.reset_count) for e in estimates if e.target == "leader"]
    assert counts == sorted(counts)
