"""Ranges beside the images in the pipeline: they teach the size, and carry nothing."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.config import Config
from onboard.messages import Clock, DistanceReading, TargetImage
from onboard.models.relative_motion import SIZE
from tests.support.broadcast import merged
from tests.support.streams import CIRCLE, EPOCH, MS, Item, Run, S, Stream, advance, encode, feed, make_config
from tests.support.streams import SIZE as TRUE_SIZE

SENSOR = 7
Range = Callable[[float], float | None]


def configured(*overrides: str) -> Config:
    """With a size that is 25 % too large, at a standard deviation of 30 %."""
    prior = ("size_prior_m=2.5", "size_prior_sigma_m=0.75", f"range.sensor={SENSOR}")
    return make_config(*(f"estimator.leader.{key}" for key in prior), *overrides)


def true_range(t: float) -> float:
    return float(np.linalg.norm(CIRCLE.relative(t)[0]))


def readings(t0: float, t1: float, measured: Range = true_range, sensor: int = SENSOR) -> list[Item]:
    """A DISTANCE_SENSOR five times a second, without delay."""
    items = []
    for ms in range(round(t0 * 1000), round(t1 * 1000), 200):
        t_recv_ns = EPOCH + ms * MS + 2 * MS
        distance = measured(ms / 1000)
        head = {"t_ns": t_recv_ns, "t_recv_ns": t_recv_ns, "clock": Clock.NONE}
        items.append(Item(t_recv_ns, DistanceReading(**head, sensor=sensor, distance=distance, sigma=0.1)))
    return items


def fly(
    reports: list[Item], t1: float, config: Config | None = None, images: Callable[[float], bool] = lambda _t: True
) -> Run:
    items = merged(Stream(t1=t1, images=images, sparse=True).items(), reports)
    return feed(encode(items), config or configured())


def counts(run: Run) -> dict[str, int]:
    """The verdicts on ranges, counted."""
    verdicts = run.pipeline.health(0).verdicts
    return {key.removeprefix("leader.range_"): n for key, n in verdicts.items() if "range_" in key}


def size_of(run: Run) -> tuple[float, float]:
    """The error of the last size and its standard deviation, as shares of it."""
    last = run.estimates[-1]
    assert last.mean is not None
    assert last.covariance is not None
    return last.mean[SIZE] / TRUE_SIZE - 1.0, math.sqrt(last.covariance[SIZE][SIZE]) / TRUE_SIZE


def test_a_rangefinder_teaches_the_size_seed_2() -> None:
    """The shipped filter; ranges 0.1 m off."""
    rng = np.random.default_rng(2)
    run = fly(readings(6.0, 20.0, lambda t: true_range(t) + 0.1 * rng.normal()), 20.0, configured())
    error, sigma = size_of(run)
    assert abs(error) < 0.06
    assert abs(error) / 3.0 < sigma < 0.08  # as sure as the images are of the heading
    assert run.estimates[-1].valid
    found = counts(run)  # few of an open range expect the first readings
    assert set(found) <= {"fused", "gated"}
    assert found["fused"] > 10 * found.get("gated", 0)


def test_another_sensor_is_not_used() -> None:
    run, plain = fly(readings(6.0, 8.0, sensor=SENSOR + 1), 8.0), fly([], 8.0)
    assert run.estimates == plain.estimates
    assert not counts(run)


def test_a_range_to_the_ground_is_rejected() -> None:
    run = fly(readings(6.0, 11.0, lambda t: 5.0 if t >= 10.0 else true_range(t)), 11.0, configured())
    assert counts(run) == {"fused": 20, "gated": 5}
    before = fly(readings(6.0, 10.0), 11.0, configured())
    assert size_of(run)[0] == pytest.approx(size_of(before)[0], abs=0.001)


def test_a_sensor_that_measures_nothing_is_counted() -> None:
    run = fly(readings(6.0, 8.0, lambda _t: None), 8.0)
    assert counts(run) == {"no_position": 10}
    assert size_of(run)[1] > 0.2


def test_ranges_before_an_image_has_shown_the_leader_teach_nothing() -> None:
    run = fly(readings(6.0, 7.0), 7.0, images=lambda _t: False)
    assert counts(run) == {"initialising": 5}


def test_a_detection_brings_its_range() -> None:
    config = configured("estimator.leader.range.sensor=-1", "estimator.leader.range.detections=true")
    items = [
        Item(i.t_recv_ns, replace(i.message, range=true_range(i.message.t_ns / S)))
        if isinstance(i.message, TargetImage)
        else i
        for i in Stream(t1=14.0, sparse=True).items()
    ]
    taught, plain = make_run(items, config), make_run(items, configured())
    assert size_of(plain)[1] > 0.2
    assert abs(size_of(taught)[0]) < 0.13
    assert size_of(taught)[1] < 0.25
    assert counts(taught)["fused"] > 60
    assert not counts(plain)


def make_run(items: list[Item], config: Config) -> Run:
    """Messages through a new pipeline, without encoding: MAVLink's images have no range."""
    return advance([item.message for item in items], config)


def test_true_ranges_without_images_do_not_cost_the_size() -> None:
    """Their mean passed through us, they held it there, and the size paid: up to 65 % at a sigma of 2 %."""
    config, gap = configured(), 9.0
    run = fly(readings(6.0, 18.0 + gap), 18.0 + gap, config, images=lambda t: not 14.0 <= t < 14.0 + gap)
    error, sigma = size_of(run)
    assert abs(error) < min(3.0 * sigma, 0.125)
    assert counts(run).get("gated", 0) == 0
    assert run.estimates[-1].valid
