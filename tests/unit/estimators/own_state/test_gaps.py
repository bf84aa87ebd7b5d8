"""A gap of any length costs no more than one of a second."""

import pytest
from msgspec.structs import replace

from onboard.config import parse_config
from onboard.estimators.own_state import track as tracks
from onboard.messages import Message, NavState
from onboard.pipeline import Pipeline
from tests.support import own_vehicle as own
from tests.support.streams import S


@pytest.mark.parametrize("gap_s", [31, 600, 3600, 10**6])
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
