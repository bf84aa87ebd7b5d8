"""The paper's filter as an estimator: beside the leader on the same images; late, missing and wrong images; a
failure of it."""

import math

import pytest

from onboard.config import load_config, parse_config
from onboard.estimators import config_type
from onboard.filters.belief import FilterError
from onboard.messages import Datagram, Estimate, Lifecycle, Output, TargetPoints, Verdict
from onboard.pipeline import Pipeline
from simlink.scenarios.scenario import load_scenario
from tests.support import kept
from tests.support.streams import Item, Run, Stream, advance

SIZE = 2.667


def flown(*names: str, seconds: float = 6.0) -> tuple[Pipeline, list[Output]]:
    pipeline = Pipeline(parse_config({"estimator": {name: {"size_prior_m": SIZE} for name in names}}))
    outputs: list[Output] = []
    for item in kept.flight(load_scenario("formation"), 3, seconds):
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


def alone(items: list[Item], *settings: str) -> Run:
    return advance((item.message for item in items), load_config(None, ("estimator.oh_johnson={}", *settings)))


def test_an_image_that_comes_late_changes_the_belief_as_one_in_time_seed_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    items = Stream(t1=7.0, sparse=True).items()
    at = next(i for i, item in enumerate(items) if isinstance(item.message, TargetPoints) and i > len(items) // 2)
    late = [*items[:at], *items[at + 1 : at + 12], items[at], *items[at + 12 :]]
    in_time, after = alone(items), alone(late)
    assert in_time.verdicts().get(Verdict.FUSED_LATE, 0) == 0
    assert after.verdicts()[Verdict.FUSED_LATE] == 1
    assert after.estimates[-1].mean == pytest.approx(in_time.estimates[-1].mean, rel=1e-9, abs=1e-9)
    monkeypatch.setattr(config_type("oh_johnson"), "rewind_horizon_s", 0.05)
    too_late = alone(late)
    assert too_late.verdicts()[Verdict.TOO_OLD] == 1
    assert too_late.estimates[-1].valid


def test_without_images_it_coasts_is_lost_and_forgets_seed_1() -> None:
    run = alone(Stream(t1=18.5, images=lambda t: t < 6.0 or t > 18.0, sparse=True).items())
    states: list[tuple[Lifecycle, bool]] = []
    for e in run.estimates:
        if not states or states[-1] != (e.state, e.valid):
            states.append((e.state, e.valid))
    assert states == [
        (Lifecycle.SEARCHING, False),
        (Lifecycle.TRACKING, True),
        (Lifecycle.COASTING, True),
        (Lifecycle.LOST, False),
        (Lifecycle.SEARCHING, False),
        (Lifecycle.TRACKING, True),
    ]
    coasting = [e for e in run.estimates if e.state is Lifecycle.COASTING]
    assert 0.25 < coasting[0].age < coasting[-1].age <= 2.0
    spread = [sum(e.covariance[i][i] for i in range(3)) for e in coasting if e.covariance is not None]
    assert spread[-1] > 2.0 * spread[0]
    assert run.estimates[-1].reset_count == 1
