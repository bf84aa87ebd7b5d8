"""What is postponed until an estimate is published changes no estimate, and delays none."""

import asyncio
from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.daemon import Daemon
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.filters import any_side
from onboard.estimators.leader.filters.any_side import finished
from onboard.estimators.leader.filters.choice import make_filter
from onboard.estimators.leader.filters.noses import particles
from onboard.estimators.leader.filters.postponed import Postponed
from onboard.messages import Datagram, Estimate, Output
from onboard.ownship import Step
from onboard.pipeline import Pipeline
from tests.faults.test_silence import Wire
from tests.support.faulty_flight import DATAGRAMS
from tests.support.streams import MS, Stream, feed, make_config
from tests.unit.estimators.leader.test_any_side import STILL, image

BEGUN = 6.5  # s of the boot clock: the cloud has confirmed the wing-line filter


@pytest.fixture
def updates(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """An entry for each image that a cloud takes."""
    made: list[int] = []
    update = particles.update

    def counted(*arguments: object) -> object:
        made.append(1)
        return update(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(particles, "update", counted)
    return made


def finishing(datagrams: list[Datagram]) -> list[Output]:
    """The outputs of a pipeline that finishes after each datagram, as the daemon's does."""
    pipeline, outputs = Pipeline(make_config()), []
    for datagram in datagrams:
        outputs.extend(pipeline.feed(datagram))
        pipeline.finish()
    assert not pipeline.errors
    return outputs


@pytest.mark.parametrize("latency_ms", [5, 60, 200])
def test_an_estimate_is_the_same_whenever_the_cloud_takes_its_image_seed_1(latency_ms: int) -> None:
    datagrams = Stream(t1=8.0, latency=latency_ms * MS).datagrams()
    assert finishing(datagrams) == feed(datagrams).outputs


@pytest.mark.parametrize("latency_ms", [5, 60])
def test_no_estimate_waits_for_the_cloud_where_images_come_often_seed_2(
    updates: list[int], latency_ms: int
) -> None:
    pipeline, late = Pipeline(make_config()), 0
    for datagram in Stream(t1=9.0, seed=2, latency=latency_ms * MS).datagrams():
        before = len(updates)
        outputs = pipeline.feed(datagram)
        if any(isinstance(o, Estimate) and o.measurement is not None and o.t_ns > BEGUN * 1e9 for o in outputs):
            late += len(updates) > before
        pipeline.finish()
    assert late == 0
    assert len(updates) >= 3.0 / 0.16  # one image in four


def test_a_slow_camera_gets_the_whole_estimate_at_once_seed_3(updates: list[int]) -> None:
    pipeline, whole, images = Pipeline(make_config()), 0, 0
    for datagram in Stream(t1=12.0, seed=3, images=lambda t: round(t * 1000) % 240 == 0).datagrams():
        before = len(updates)
        outputs = pipeline.feed(datagram)
        if any(isinstance(o, Estimate) and o.measurement is not None and o.t_ns > 8e9 for o in outputs):
            images += 1
            whole += len(updates) > before
    assert whole == images > 10


@pytest.mark.parametrize("last_ms", [7000, 7040, 7080, 7120])
def test_the_last_image_counts_without_another_one_seed_4(updates: list[int], last_ms: int) -> None:
    datagrams = Stream(t1=7.6, seed=4, images=lambda t: round(t * 1000) <= last_ms).datagrams()
    feed(datagrams)
    alone = len(updates)
    updates.clear()
    finishing(datagrams)
    assert alone == len(updates)


def test_the_cloud_is_the_same_as_if_no_image_were_postponed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the next image comes so late that the cloud would have been predicted meanwhile."""

    def flown(often: float) -> tuple[list[Array], int]:
        monkeypatch.setattr(any_side, "OFTEN_S", often)
        filter_, rest = make_filter(Config(size_prior_m=2.0)), np.zeros(3)
        state, clouds, postponed = filter_.start(image(25.0, 0.0), STILL, None), [], 0
        for k in range(1, 30):
            for _ in range(4 + 2 * (k % 3 == 0)):
                state = filter_.advance(state, Step(0.02, rest, rest, rest))
            state = filter_.fuse(state._replace(confirmed=True), image(25.0, 0.0, seed=k), STILL).belief
            postponed += state.postponed is not None
            clouds.append(finished(state).cloud.means)
        return clouds, postponed

    (later, postponed), (at_once, none) = flown(any_side.OFTEN_S), flown(0.0)
    assert (postponed > 5, none) == (True, 0)
    assert all(map(np.array_equal, later, at_once))


@pytest.mark.parametrize(
    ("every_ms", "taken_after_ms"), [(40, 160), (120, 240), (240, 240), (280, 280), (440, 440)]
)
@pytest.mark.parametrize("confirmed", [False, True])
def test_the_cloud_takes_few_images_of_a_fast_camera_and_all_of_a_slow_one(
    confirmed: bool, every_ms: int, taken_after_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it has been predicted meanwhile."""
    now_ms, taken, update = 0, [], particles.update

    def noted(*arguments: Any) -> Any:
        taken.append(now_ms)
        return update(*arguments)

    monkeypatch.setattr(particles, "update", noted)
    filter_, rest = make_filter(Config(size_prior_m=2.0)), np.zeros(3)
    state = filter_.start(image(25.0, 0.0), STILL, None)
    for k in range(1, 30):
        for _ in range(every_ms // 40):
            state = filter_.advance(state, Step(0.04, rest, rest, rest))
        now_ms += every_ms
        state = filter_.fuse(state._replace(confirmed=confirmed), image(25.0, 0.0, seed=k), STILL).belief
        filter_.finish(state)
    assert set(np.diff(taken)) == {taken_after_ms}


def test_our_own_motion_since_a_postponed_image_is_kept() -> None:
    filter_, north = make_filter(Config(size_prior_m=2.0)), np.array([3.0, 0.0, 0.0])
    state = filter_.start(image(25.0, 0.0), STILL, None)
    for k in range(1, 10):
        for _ in range(2):
            state = filter_.advance(state, Step(0.02, north, north, np.zeros(3)))
        if state.postponed is not None:
            break
        state = filter_.fuse(state._replace(confirmed=True), image(25.0, 0.0, seed=k), STILL).belief
    assert state.postponed is not None
    pending = finished(state).pending
    assert pending.dt == pytest.approx(0.04)
    assert pending.moved == pytest.approx(0.04 * north)


def test_an_image_counts_at_once_where_the_estimate_is_the_clouds_own() -> None:
    filter_, rest, aspect = make_filter(Config(size_prior_m=2.0)), np.zeros(3), 1.2
    state, uncertain = filter_.start(image(25.0, aspect), STILL, None), 0
    for k in range(1, 30):
        for _ in range(2):
            state = filter_.advance(state, Step(0.04, rest, rest, rest))
        state = filter_.fuse(state, image(25.0, aspect, seed=k), STILL).belief
        if not state.confirmed:
            uncertain += 1
            assert state.postponed is None
    assert uncertain > 10


def test_what_fails_is_tried_again_and_what_is_found_is_kept() -> None:
    tries: list[int] = []

    def compute() -> int:
        tries.append(1)
        if len(tries) == 1:
            raise ValueError("not yet")
        return 7

    postponed = Postponed(compute)
    with pytest.raises(ValueError, match="not yet"):
        postponed.value()
    assert [postponed.value(), postponed.value()] == [7, 7]
    assert len(tries) == 2


def test_the_daemon_finishes_once_an_estimate_with_an_image_is_published(monkeypatch: pytest.MonkeyPatch) -> None:
    daemon, wire = Daemon(make_config("zenoh.enabled=false", "link=[]"), report=lambda _line: None), Wire()
    daemon._sinks = {"wire": wire}  # type: ignore[dict-item]

    async def fly() -> int:
        published = asyncio.get_running_loop().create_future()
        monkeypatch.setattr(daemon._pipeline, "finish", lambda: published.set_result(len(wire.records)))
        finishes = asyncio.create_task(daemon._finish())
        await asyncio.sleep(0.0)
        for datagram in DATAGRAMS:
            daemon._deliver(datagram)
        assert not published.done()
        records: int = await asyncio.wait_for(published, 10.0)
        finishes.cancel()
        return records

    assert asyncio.run(fly()) == len(wire.records)
