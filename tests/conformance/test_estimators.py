"""What every estimator of onboard/estimators does, found and not listed, on flights of simlink."""

import json

import msgspec
import numpy as np
import pytest

from onboard.config import parse_config
from onboard.estimators import known, load
from onboard.messages import Estimate, Message, NavState, Output
from onboard.messages.schemas import key_of
from onboard.pipeline import Pipeline
from simlink.scenarios.scenario import load_scenario
from tests.support import kept

FLIGHTS = ("traffic", "quadrotor")  # the first has a leader, too

NOTHING = {(name, "quadrotor") for name in ("leader", "oh_johnson", "traffic")}  # there is none


def flown(name: str, scenario: str, seconds: float = 3.0) -> list[Output]:
    pipeline = Pipeline(parse_config({"estimator": {name: {}}}))
    outputs: list[Output] = []
    for item in kept.flight(load_scenario(scenario), 3, seconds):
        if not isinstance(item, Message) and hasattr(item, "data"):
            outputs += pipeline.feed(item)
    return outputs


@pytest.mark.parametrize("name", known())
def test_it_says_what_it_listens_for_and_its_defaults_hold(name: str) -> None:
    module = load(name)
    assert all(issubclass(kind, Message) for kind in module.LISTENS)
    module.Estimator(module.Config(), parse_config({"estimator": {}}).camera_model())


@pytest.mark.parametrize("scenario", FLIGHTS)
@pytest.mark.parametrize("name", known())
def test_what_it_tells_is_whole_and_the_same_again_seed_3(name: str, scenario: str) -> None:
    outputs = flown(name, scenario)
    assert outputs == flown(name, scenario)
    published = [o for o in outputs if isinstance(o, Estimate)]
    assert any(e.valid for e in published) or (name, scenario) in NOTHING
    for estimate in published:
        assert estimate.name == name
        assert len(estimate.components) == len(estimate.units)
        json.loads(msgspec.json.encode(estimate))
        assert key_of(estimate)
        if estimate.mean is None or estimate.covariance is None:
            assert not estimate.valid
            continue
        covariance = np.array(estimate.covariance)
        assert np.isfinite(estimate.mean).all()
        assert len(estimate.mean) == len(estimate.components) == len(covariance)
        assert np.allclose(covariance, covariance.T, rtol=1e-9, atol=1e-12)
        assert np.linalg.eigvalsh(covariance).min() > -1e-9


def test_own_state_comes_of_any_vehicle_s_messages_seed_3() -> None:
    """A fixed wing at 21 m/s in a turn, on defaults: not the vehicle it was made for."""
    states = [o for o in flown("own_state", "formation", 10.0) if isinstance(o, NavState)]
    assert states[-1].valid
    assert states[-1].reset_count == 0
