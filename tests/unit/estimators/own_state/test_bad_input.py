"""The own-state estimator without the input that it needs, and with input that it cannot use."""

import math
from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.own_state.config import Config
from onboard.messages import Barometer, GpsFix, LocalPosition, Message, NavState, Verdict
from onboard.pipeline import Pipeline
from tests.support.own_vehicle import MS, attitude, fix, header, heartbeat, hovering, imu, pipeline, states_of


def test_it_waits_for_a_fix_coasts_through_an_outage_is_lost_and_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Config, "reset_timeout_s", 10.0)
    p = pipeline()
    before = states_of(p, [heartbeat(), *[attitude(t) for t in range(1000, 3000, 10)]])
    assert {(s.state, s.valid, s.quality) for s in before} == {("searching", False, -1)}
    assert before[-1].mean is None
    known = states_of(p, list(hovering(3000, 9000)))[-1]
    assert known.quality > 0
    outage = [m for m in hovering(9000, 17000) if not isinstance(m, GpsFix)]
    states = states_of(p, outage)
    assert [s.state for s in states if s.t_ns == 9_400 * MS] == ["tracking"]
    assert [s.state for s in states if s.t_ns == 12_000 * MS] == ["coasting"]
    assert (states[-1].state, states[-1].valid, states[-1].quality) == ("lost", False, -1)
    sigma = [math.sqrt(s.covariance[0][0]) for s in states if s.covariance is not None]
    assert sigma[-1] > 3 * sigma[0]
    assert states_of(p, list(hovering(17000, 18000)))[-1].state == "tracking"
    gone = states_of(p, [m for m in hovering(18000, 29000) if not isinstance(m, GpsFix)])[-1]
    assert (gone.mean, gone.reset_count) == (None, 1)


def test_a_silent_autopilot_is_reported() -> None:
    p = pipeline()
    states_of(p, [heartbeat(), *hovering(1000, 5000)])
    where = [LocalPosition(**header(t), r_OF_n=(0, 0, 0), v_F_n=(0, 0, 0)) for t in range(5000, 7000, 20)]
    states = states_of(p, where)
    assert [(s.state, s.valid) for s in states] == [("lost", False)]
    assert "attitude" in states[0].reason


@cache
def hovered() -> tuple[Pipeline, NavState]:
    """A pipeline after four seconds, and its last state."""
    p = pipeline(publish_rate_hz=100.0)
    return p, states_of(p, [heartbeat(), *hovering(1000, 5000)])[-1]


@pytest.mark.parametrize(
    ("message", "verdict"),
    [
        (attitude(5010, (math.nan, 0, 0, 0)), Verdict.NOT_FINITE),
        (attitude(5010, (0, 0, 0, 0)), Verdict.DEGENERATE),
        (attitude(5010, (1, 0, 0, 0), (1e4, 0, 0)), Verdict.DEGENERATE),
        (replace(fix(5000), lat_deg=math.nan), Verdict.NOT_FINITE),
        (replace(fix(5000), lat_deg=-47.0), Verdict.DEGENERATE),
        (fix(3000), Verdict.TOO_OLD),
        (fix(5900), Verdict.TOO_NEW),
        (Barometer(**header(5000), pressure_altitude=math.nan), Verdict.NOT_FINITE),
        (replace(imu(5000), pressure_altitude=1e7), Verdict.DEGENERATE),
    ],
)
def test_an_unusable_message_is_reported_and_leaves_the_state(message: Message, verdict: Verdict) -> None:
    p, before = deepcopy(hovered())
    (after,) = states_of(p, [message])
    assert after.measurement is not None
    assert after.measurement.verdict is verdict
    assert after.mean == before.mean
    assert after.valid


def test_nan_from_the_accelerometer_is_ignored() -> None:
    p = pipeline()
    messages = list(hovering(1000, 5000))
    states = states_of(p, [heartbeat(), *messages, imu(5000, (math.nan, 0, 0)), attitude(5010), attitude(5020)])
    assert states[-1].valid
    assert np.isfinite(states[-1].mean).all()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"lat_deg": math.nan}, "lat_deg: not a finite number"),
        ({"alt_msl": math.inf, "v_down": math.nan}, "alt_msl and v_down: not a finite number"),
        ({"ground_speed": 1e5}, "a place or a velocity that no vehicle has"),
    ],
)
def test_fixes_that_cannot_be_used_are_not_taken_for_none(changes: dict[str, float], reason: str) -> None:
    p = pipeline()
    stream = [replace(m, **changes) if isinstance(m, GpsFix) else m for m in hovering(1000, 6000)]
    assert reason in states_of(p, [heartbeat(), *stream])[-1].reason
    (refusal,) = [r for r in p.health(0).refusals if r.source == "our own gps"]
    assert "expected" in refusal.reason
