"""The wall clock is set during a flight: arrivals and timers do not notice, and images keep their time."""

from functools import cache
from pathlib import Path

import pytest
from msgspec.structs import replace

from onboard.messages import Datagram, TargetPoints, Verdict
from onboard.wire.logs.recording import read_recording
from tests.support.cases import slow_but
from tests.support.faulty_flight import ITEMS, assert_on_target, flown
from tests.support.records import record
from tests.support.streams import EPOCH, MS, Item, Run, S, encode
from tests.unit.links.test_host_clock import STEPS

SET_NS = 46 * S + 10 * MS  # on the boot clock


def flight(step: float, *, jitter: int = 0) -> list[Datagram]:
    """Images carry stamps of the wall clock, which is set in flight; those on their way carry the old time."""
    step_ns = round(step * S)
    items = []
    for i in ITEMS:
        if isinstance(i.message, TargetPoints):
            stamp = EPOCH + i.message.t_ns + (step_ns if i.message.t_ns > SET_NS else 0)
            late = jitter * (i.message.t_ns // (40 * MS) % 3) * MS
            items.append(Item(i.t_recv_ns + late, replace(i.message, t_ns=stamp)))
        else:
            items.append(i)
    datagrams = encode(sorted(items, key=lambda item: item.t_recv_ns))
    return [replace(d, wall_step_ns=step_ns if d.t_recv_ns > EPOCH + SET_NS else 0) for d in datagrams]


@cache
def calm() -> Run:
    """The flight in which the clock is not set."""
    return flown(flight(0.0))


@pytest.mark.parametrize("step", slow_but([min(STEPS), -0.5, 0.01, max(STEPS)], STEPS))
def test_images_keep_their_time_when_the_wall_clock_is_set(step: float) -> None:
    run = flown(flight(step))
    assert run.rejected == {"host_clock_steps": 1}
    assert [e.mean for e in run.estimates] == [e.mean for e in calm().estimates]
    assert run.verdicts() == calm().verdicts()


@pytest.mark.parametrize("step", [min(STEPS), -0.5, 0.01, max(STEPS)])
def test_images_of_varying_latency_keep_their_time_but_for_few(step: float) -> None:
    run = flown(flight(step, jitter=15))
    assert_on_target(run)
    assert sum(n for v, n in run.verdicts().items() if v not in {Verdict.INITIALISING, Verdict.FUSED}) <= 3


def test_a_stalled_link_is_not_taken_for_a_clock_that_was_set() -> None:
    """Without TIMESYNC: two seconds of the autopilot's messages arrive at once."""
    held = [replace(d, wall_step_ns=0) for d in encode(ITEMS)]
    until = EPOCH + 48 * S
    late = [replace(d, t_recv_ns=max(d.t_recv_ns, until)) if d.t_recv_ns > until - 2 * S else d for d in held]
    run = flown(sorted(late, key=lambda d: d.t_recv_ns))
    assert run.rejected == {}
    assert run.pipeline.health(0).clock_offset_ns == EPOCH + 2 * MS
    assert_on_target(run)


def test_a_recording_keeps_the_steps(tmp_path: Path) -> None:
    datagrams = flight(-0.5)
    record(tmp_path / "flight.mcap", datagrams)
    assert [d for d, _ in read_recording(tmp_path / "flight.mcap") if d is not None] == datagrams
