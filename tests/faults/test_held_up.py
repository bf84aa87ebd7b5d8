"""The autopilot's messages are held up on their way, without TIMESYNC; images carry stamps of this computer."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import Clock, Datagram, Estimate, Output, TargetPoints
from onboard.models.relative_motion import POSITION
from onboard.pipeline import Pipeline
from onboard.pipeline.silence import BEHIND, HELD_UP
from tests.support.faulty_flight import ITEMS, T0, T1
from tests.support.images import exposed
from tests.support.streams import EPOCH, MS, Item, Run, S, Stream, encode, make_config, position_error

BEGINS = EPOCH + 46 * S


def held_up(late_ns: Callable[[int], int], items: list[Item] = ITEMS) -> Run:
    """The flight, the autopilot's messages of each arrival late by so much."""
    pipeline, run = Pipeline(make_config()), []
    for i in items:
        if isinstance(i.message, TargetPoints):
            stamp = EPOCH + i.message.t_ns
            run.append((i.t_recv_ns, replace(i.message, t_ns=stamp, clock=Clock.HOST), None))
        else:
            t_recv_ns = i.t_recv_ns + late_ns(i.t_recv_ns)
            run.append((t_recv_ns, None, encode([Item(t_recv_ns, i.message)])[0]))
    outputs = []
    for t_recv_ns, image, datagram in sorted(run, key=lambda r: r[0]):
        empty = Datagram(channel="udp", encoding=encode(ITEMS[:1])[0].encoding, t_recv_ns=t_recv_ns, data=b"")
        messages = pipeline.decode(replace(datagram or empty, wall_step_ns=0))
        outputs.extend(pipeline.advance(exposed([replace(image, t_recv_ns=t_recv_ns)] if image else messages)))
    assert not pipeline.errors
    return Run(pipeline, outputs)


def after(run: Run, seconds: float = 0.0) -> list[Estimate]:
    return [e for e in run.estimates if e.t_ns > BEGINS - EPOCH + round(seconds * S)]


@pytest.mark.parametrize("late_ms", [100, 450])
def test_a_link_that_is_late_for_good_does_not_bend_the_time_base(late_ms: int) -> None:
    longer = Stream(t0=40.0, t1=64.0, seed=21, sparse=True).items()
    run = held_up(lambda t: late_ms * MS if t > BEGINS else 0, longer)
    assert run.pipeline.clocks.offset_ns == pytest.approx(EPOCH + 2 * MS, abs=4 * MS)
    assert run.rejected == {}
    assert all(e.valid and position_error(e) < 2.0 for e in after(run))


@pytest.mark.parametrize("late_ms", [700, 2000])
def test_while_a_link_is_late_by_more_than_estimates_may_be_old_nothing_is_valid(late_ms: int) -> None:
    run = held_up(lambda t: late_ms * MS if t > BEGINS else 0)
    assert after(run)
    assert {(e.valid, e.cause, e.reason) for e in after(run)} == {(False, *HELD_UP)}
    assert run.pipeline.clocks.offset_ns == EPOCH + 2 * MS


@pytest.mark.parametrize("stall_ms", [100, 500, 2000])
def test_a_link_that_stalls_and_then_sends_all_at_once(stall_ms: int) -> None:
    until = BEGINS + stall_ms * MS
    run = held_up(lambda t: until - t if BEGINS < t < until else 0)
    assert run.pipeline.clocks.offset_ns == EPOCH + 2 * MS
    assert "host_clock_steps" not in run.rejected
    late = after(run, stall_ms / 1000 + 0.5)
    assert all(e.valid and position_error(e) < 1.9 for e in late)
    assert late[-1].t_ns == round(T1 * S) - 40 * MS


def test_what_has_waited_in_this_program_is_not_valid_and_not_the_link_s_doing() -> None:
    """As a process that is paused, or has too little time, reads it; a recording of it replays alike."""
    waits_us = {"valid": 300_000, "late": 700_000, "later": 2_000_000}
    for kind, waited_us in waits_us.items():
        pipeline, outputs = Pipeline(make_config()), list[Output]()
        for datagram in encode(ITEMS):
            is_late = datagram.t_recv_ns > BEGINS
            outputs += pipeline.feed(replace(datagram, wall_step_ns=0, waited_us=is_late * waited_us))
        late = after(Run(pipeline, outputs))
        expected = {True} if kind == "valid" else {BEHIND}
        assert {e.valid or (e.cause, e.reason) for e in late if e.t_ns > BEGINS - EPOCH + 100 * MS} == expected
        assert pipeline.clocks.offset_ns == EPOCH + 2 * MS


def spread(estimate: Estimate) -> float:
    """The standard deviation of the position, m."""
    return math.sqrt(np.trace(np.array(estimate.covariance)[POSITION, POSITION]))


def test_a_link_that_was_late_from_the_start_is_corrected_when_it_no_longer_is() -> None:
    """Until then nothing shows it: without TIMESYNC a clock's offset and a constant delay look the same."""
    run = held_up(lambda t: 600 * MS if t < BEGINS else 0, Stream(t0=T0, t1=T1, seed=21, sparse=True).items())
    assert run.rejected["clock_corrections"] == 1
    before = [e for e in run.estimates if e.t_ns < BEGINS - EPOCH - S and e.valid]
    assert max(map(position_error, before)) > 1.5
    assert all(not e.valid or position_error(e) < 3.0 * spread(e) for e in after(run, 1.0))  # the track is new
    assert all(not e.valid or position_error(e) < 3.0 for e in after(run, 4.0))
    assert run.estimates[-1].valid
