"""The paper's filter as an estimator: beside the leader on the same images, late images, a failure of it."""

import math

import pytest

from onboard.config import parse_config
from onboard.filters.belief import FilterError
from onboard.messages import Datagram, Estimate, Output, TargetPoints, Verdict
from onboard.pipeline import Pipeline
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import datagrams

SIZE = 2.667


def flown(*names: str, seconds: float = 6.0) -> tuple[Pipeline, list[Output]]:
    pipeline = Pipeline(parse_config({"estimator": {name: {"size_prior_m": SIZE} for name in names}}))
    outputs: list[Output] = []
    for item in datagrams(load_scenario("formation"), 3, seconds):
        if isinstance(item, Datagram):
            outputs += pipeline.feed(item)
    return pipeline, outputs


def of(outputs: list[Output], name: str) -> list[Estimate]:
    return [o for o in outputs if isinstance(o, Estimate) and o.name == name]


def test_the_leader_s_estimates_are_the_same_with_and_without_it_seed_3() -> None:
    _, both = flown("leader", "oh_johnson")
    _, alone = flown("leader")
    assert of(both, "leader") == of(alone, "leader")
    paper = of(both, "oh_johnson")
    assert paper[-1].valid
    assert math.hypot(*(paper[-1].mean or ())[:3]) == pytest.approx(28.0, rel=0.15)


def test_when_it_fails_the_leader_flies_on_seed_3(monkeypatch: pytest.MonkeyPatch) -> None:
    _, alone = flown("leader")

    def fail(*_: object) -> None:
        raise FilterError("broken")

    monkeypatch.setattr("onboard.filters.unscented.predict", fail)
    pipeline, both = flown("leader", "oh_johnson")
    assert of(both, "leader")[-1].valid
    assert of(both, "leader") == of(alone, "leader")
    assert "the filter failed: broken" in {e.reason for e in of(both, "oh_johnson")}
    assert pipeline.errors == []


def test_an_image_that_comes_again_is_a_duplicate_seed_3() -> None:
    pipeline, outputs = flown("oh_johnson")
    last = next(e.measurement for e in reversed(of(outputs, "oh_johnson")) if e.measurement)
    assert last.points is not None
    again = TargetPoints(
        camera=last.source,
        t_ns=last.t_ns,
        t_recv_ns=last.t_recv_ns,
        center=last.points[0],
        left=last.points[1],
        right=last.points[2],
    )
    made = pipeline.estimators["oh_johnson"].observe(again, pipeline.ownship)
    assert made[0].measurement is not None
    assert made[0].measurement.verdict is Verdict.DUPLICATE
