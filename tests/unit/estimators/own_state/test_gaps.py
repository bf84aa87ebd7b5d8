"""A gap of any length costs no more than one of a second, and makes no push."""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.config import parse_config
from onboard.estimators.own_state import track as tracks
from onboard.messages import Attitude, GpsFix, Imu, Message, NavState
from onboard.pipeline import Pipeline
from tests.support import own_vehicle as own
from tests.support.streams import S


@pytest.mark.parametrize("gap_s", [10**6])
def test_the_track_ends_before_it_is_predicted_over_a_gap(gap_s: int, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = 0
    step = tracks.Track._step

    def counted(*args: object) -> object:
        nonlocal steps
        steps += 1
        return step(*args)

    monkeypatch.setattr(tracks.Track, "_step", counted)
    pipeline = Pipeline(parse_config({"estimator": {"own_state": {}}}))
    before = pipeline.advance([own.heartbeat(), *own.hovering(10_000, 14_000)])
    assert [e for e in before if isinstance(e, NavState)][-1].valid
    flown = steps

    def later(message: Message) -> Message:
        by = gap_s * S
        return replace(message, t_ns=message.t_ns + by, t_recv_ns=message.t_recv_ns + by)

    after = pipeline.advance([later(m) for m in own.hovering(14_000, 18_000)])
    states = [e for e in after if isinstance(e, NavState)]
    assert steps - flown < 3 * flown  # as many as without a gap
    assert states[-1].valid
    assert states[-1].reset_count == 1


@pytest.mark.parametrize(("kinds", "gap_ms"), [((Imu,), 300), ((Attitude,), 1000), ((Imu, GpsFix), 2600)])
def test_a_gap_of_some_inputs_widens_the_velocity_and_does_not_move_it(
    kinds: tuple[type[Message], ...], gap_ms: int
) -> None:
    flown = [
        m
        for m in own.hovering(10_000, 17_000)
        if not (isinstance(m, kinds) and 14_000 < m.t_ns / own.MS < 14_000 + gap_ms)
    ]
    states = own.states_of(own.pipeline(), [own.heartbeat(), *flown])
    valid = [e for e in states if e.valid and e.mean is not None and e.covariance is not None]
    velocity = np.array([e.mean[3:6] for e in valid])
    sigma = np.sqrt([np.diag(e.covariance)[3:6] for e in valid])
    assert np.abs(velocity).max() < 0.3
    assert (np.abs(velocity) < 3.0 * sigma).all()
    t = np.array([e.t_ns / own.MS for e in valid])
    assert valid[-1].t_ns > 16_900 * own.MS
    if Imu in kinds and Attitude not in kinds:  # nothing drives it then
        assert sigma[(t > 14_200) & (t < 14_000 + gap_ms)].max() > 1.5 * sigma[t < 14_000][-20:].max()
