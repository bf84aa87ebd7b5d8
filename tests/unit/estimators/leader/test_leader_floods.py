"""Floods of target names: the leader's estimates stay as they are, and what is published stays bounded."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader import estimator as leader
from onboard.estimators.leader.image.prepare import Image
from onboard.estimators.leader.tracks.fusing import ImageRecord, Predicted
from onboard.estimators.leader.tracks.track import Track
from onboard.geometry.camera import make_camera
from onboard.messages import Estimate, Lifecycle, Message, TargetPoints
from onboard.ownship import Ownship
from tests.support.images import exposed
from tests.support.streams import Flight, Item, S, Stream, advance, make_config

NEAR = Flight(radius=None, gap=25.0)
SIDE = 0.25  # rad
T0, T1 = 5, 13
NAMES = 40  # new ones in each image, of 25 a second


def flooded(items: list[Item]) -> list[Item]:
    """Beside each image of the leader, images of aircraft that are named nowhere else."""
    more = []
    for n, item in enumerate(items):
        m = item.message
        if isinstance(m, TargetPoints):
            center, left, right = ((u + SIDE, v) for u, v in (m.center, m.left, m.right))
            for k in range(NAMES):
                name = f"flood/{n}/{k}"
                more.append(Item(item.t_recv_ns, replace(m, target=name, center=center, left=left, right=right)))
        more.append(item)
    return more


ITEMS = Stream(flight=NEAR, t1=float(T1), sparse=True).items()
IMAGES = sum(isinstance(i.message, TargetPoints) for i in ITEMS)


def estimator() -> leader.Estimator:
    config = make_config().estimator["leader"]
    return leader.Estimator(config, make_camera(f_px=554.256, width_px=640, height_px=480))


def play(one: leader.Estimator, messages: list[Message]) -> list[Estimate]:
    ownship = Ownship(max_extrapolation=0.1)
    found = []
    for m in exposed(messages):
        found += one.tick(ownship) if ownship.receive(m, m.t_ns) else one.observe(m, ownship)
    return found


def test_a_flood_of_names_changes_none_of_the_leader_s_estimates() -> None:
    calm = advance(i.message for i in ITEMS).estimates
    run = advance(i.message for i in flooded(ITEMS))
    assert [e for e in run.estimates if e.is_primary] == calm
    verdicts = run.pipeline.health(0).verdicts
    assert sum(verdicts.values()) == IMAGES * (1 + NAMES)
    assert verdicts["leader.full"] > 0.8 * IMAGES * NAMES


def test_of_many_boxes_without_ids_a_track_is_compared_with_the_nearest_with_seed_5(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """100 of them took a second an image, as every one was compared with every track without a recent image."""
    compared: Counter[int] = Counter()

    def compare(track: Track, image: Image, predicted: Predicted | None, ownship: Ownship) -> ImageRecord:
        compared[image.message.t_ns] += predicted is not None
        return right(track, image, predicted, ownship)

    right, rng, one, messages = Track.compare, np.random.default_rng(5), estimator(), list[Message]()
    monkeypatch.setattr(Track, "compare", compare)
    for item in ITEMS:
        m = item.message
        if isinstance(m, TargetPoints) and m.t_ns > 6 * S:
            for u, v in rng.uniform((-0.5, -0.35), (0.5, 0.35), (40, 2)).tolist():
                messages.append(replace(m, target="", center=(u, v), left=(u - 0.01, v), right=(u + 0.01, v)))
        if m.t_ns < 7 * S:
            messages.append(replace(m, target="") if isinstance(m, TargetPoints) else m)
    assert play(one, messages)[-1].t_ns > 6.9 * S
    assert len(one._tracks) > 20
    followed = sum(track.is_followed for track in one._tracks.values())
    assert followed > 2
    assert max(compared.values()) <= 8 * followed + 40


def test_twenty_tracks_begin_one_by_one_beside_the_leader_s() -> None:
    """To begin a track takes 10 ms, for which an image of the leader would wait twenty times."""
    one = estimator()
    messages: list[Message] = []
    for item in ITEMS:
        m = item.message
        if m.t_ns > 10 * S:
            break
        messages.append(m)
        if isinstance(m, TargetPoints) and m.t_ns > 8 * S:
            for k in range(19):
                points = [(u + SIDE - 0.03 * k, v) for u, v in (m.center, m.left, m.right)]
                center, left, right = points
                messages.append(replace(m, target=f"new/{k}", center=center, left=left, right=right))
    first: dict[str, int] = {}
    for e in play(one, messages):
        if e.state is Lifecycle.TRACKING and e.t_ns > 8 * S:
            first.setdefault(e.target, e.t_ns)
    assert len(first) == 20
    begun = sorted(first.values())[1:]
    assert min(b - a for a, b in pairwise(begun)) >= 0.03 * S  # not two with one image
    assert begun[-1] < 10 * S


def test_names_that_came_to_nothing_are_forgotten_and_said_to_be() -> None:
    one = estimator()
    messages = [
        i.message for i in flooded(ITEMS) if not isinstance(i.message, TargetPoints) or i.message.t_ns < 8 * S
    ]
    last = {e.target: e.state for e in play(one, messages)}
    assert len(last) > 100
    assert {state for target, state in last.items() if target != "leader"} == {Lifecycle.SEARCHING}
    assert list(one._tracks) == ["leader"]


def test_a_second_aircraft_is_followed_after_the_flood() -> None:
    one = estimator()
    messages: list[Message] = []
    for item in flooded(ITEMS):
        m = item.message
        if not isinstance(m, TargetPoints) or m.t_ns < 8 * S or m.target == "leader":
            messages.append(m)
            if isinstance(m, TargetPoints) and m.t_ns > 10 * S:
                center, left, right = ((u + SIDE, v) for u, v in (m.center, m.left, m.right))
                messages.append(replace(m, target="wingman", center=center, left=left, right=right))
    last = {e.target: e.state for e in play(one, messages)}
    assert last["wingman"] is Lifecycle.TRACKING
