"""Several aircraft in one camera, with and without ids; and images that show nothing new."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader import estimator as leader
from onboard.estimators.leader.image.prepare import in_view
from onboard.geometry.camera import make_camera
from onboard.messages import Exposure, TargetPoints, Verdict
from onboard.ownship import Ownship
from tests.support.images import exposed
from tests.support.streams import MS, Flight, Item, S, Stream, encode, feed, make_config

NEAR, FAR = Flight(radius=None, gap=25.0), Flight(radius=None, gap=40.0, size=3.0)
SIDE = 0.25  # rad: the second aircraft is so far to the right in the image


def second(message: TargetPoints, target: str, flight: Flight = FAR) -> TargetPoints:
    """The same image's points of another aircraft, to the right."""
    center, left, right = ((u + SIDE, v) for u, v in flight.points(message.t_ns / S).tolist())
    return replace(message, target=target, center=center, left=left, right=right)


def two_aircraft(first_id: str, second_id: str, t1: float = 8.0) -> list[Item]:
    items = []
    for item in Stream(flight=NEAR, t1=t1, sparse=True).items():
        m = item.message
        if isinstance(m, TargetPoints):
            items += [
                Item(item.t_recv_ns, replace(m, target=first_id)),
                Item(item.t_recv_ns, second(m, second_id)),
            ]
        else:
            items.append(item)
    return items


def estimator(*settings: str) -> leader.Estimator:
    """It publishes at every navigation sample."""
    config = make_config("estimator.leader.publish_rate_hz=1000", *settings).estimator["leader"]
    return leader.Estimator(config, make_camera(f_px=554.256, width_px=640, height_px=480))


def play(one: leader.Estimator, items: list[Item]) -> Ownship:
    ownship = Ownship(max_extrapolation=0.1)
    for _, m in items:
        if not ownship.receive(m, m.t_ns):
            one.observe(exposed([m])[0], ownship)
        else:
            one.tick(ownship)
    return ownship


def test_images_without_an_id_go_to_the_track_whose_prediction_they_fit() -> None:
    one = estimator()
    items = sorted(two_aircraft("", ""), key=lambda i: i.message.t_ns)
    ownship = play(one, items)
    estimates = {e.target: e for e in one.tick(ownship)}
    assert sorted(estimates) == ["leader", "unnamed/1"]
    bearings = sorted(round(float(np.arctan2(e.mean[1], e.mean[0])), 2) for e in estimates.values() if e.mean)
    assert bearings == pytest.approx([0.0, np.arctan(SIDE)], abs=0.02)


def test_there_are_no_more_targets_than_allowed() -> None:
    one = estimator("estimator.leader.max_targets=2")
    ownship = Ownship(max_extrapolation=0.1)
    reported: dict[str, int] = {}
    images = 0
    for item in Stream(flight=NEAR, t1=6.0, sparse=True).items():
        m = item.message
        if isinstance(m, TargetPoints):
            images += 1
            for k in range(4):
                for e in one.observe(Exposure.of(replace(m, target=f"target/{k}")), ownship):
                    assert e.measurement is not None
                    reported[e.target] = reported.get(e.target, 0) + (e.measurement.verdict is Verdict.FULL)
        else:
            ownship.receive(m, m.t_ns)
    assert {e.target for e in one.tick(ownship) if e.valid} == {"target/0", "target/1"}
    assert one.verdicts[Verdict.FULL] == 2 * images
    assert reported["target/0"] == reported["target/1"] == 0
    assert 0 < sum(reported.values()) <= 10  # one image too many is reported ten times a second


def test_a_camera_that_hangs_is_not_taken_for_an_aircraft() -> None:
    """From 7 s on every image repeats the same points under new stamps, while we turn."""
    swaying = Flight(radius=150.0, gap=25.0)
    frozen = swaying.image(7 * S)

    def hang(item: Item) -> Item:
        m = item.message
        if isinstance(m, TargetPoints) and m.t_ns > 7 * S:
            m = replace(m, center=frozen.center, left=frozen.left, right=frozen.right)
        return Item(item.t_recv_ns, m)

    run = feed(encode(hang(i) for i in Stream(flight=swaying, t1=12.0, sparse=True).items()))
    stale = [r for r in run.reports if r.verdict is Verdict.STALE]
    assert stale
    assert min(r.t_ns for r in stale) == pytest.approx(7.5 * S, abs=100 * MS)
    assert not any(e.valid for e in run.estimates if e.t_ns > 10 * S)


@pytest.mark.parametrize(("u", "v"), [(-1.0, 0.0), (1.0, 0.0), (0.0, -0.5), (0.0, 0.5)])
def test_a_point_within_the_margin_of_any_edge_is_out_of_view(u: float, v: float) -> None:
    """Of a frame of 2 x 1 focal lengths: 5 px count as outside, and 6 px do not."""
    camera = make_camera(f_px=100.0, width_px=200.0, height_px=100.0)
    for view in (None, (-1.0, -0.5, 1.0, 0.5)):
        for inside_px, expected in ((-1.0, False), (4.0, False), (6.0, True)):
            shrunk = 1.0 - inside_px / (100.0 * max(abs(u), abs(v)))
            assert in_view([(u * shrunk, v * shrunk)], camera, view, 5.0) is expected


def test_an_unusable_image_without_an_id_starts_no_track() -> None:
    one = estimator()
    ownship = play(one, sorted(two_aircraft("", ""), key=lambda i: i.message.t_ns))
    bad = replace(NEAR.image(ownship.now_ns), target="", center=(math.nan, 0.0))
    (estimate,) = one.observe(Exposure.of(bad), ownship)
    assert estimate.measurement is not None
    assert estimate.measurement.verdict is Verdict.NOT_FINITE
    assert estimate.target == "leader"
    assert list(one._tracks) == ["leader", "unnamed/1"]
