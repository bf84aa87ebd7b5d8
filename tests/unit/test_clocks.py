"""One time base: the offset between the clocks, from arrivals and from TIMESYNC."""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.clocks import Clocks
from onboard.messages import Clock
from onboard.messages.vehicle import TIMESYNC_TAG_NS
from tests.support.clock_messages import EPOCH, MS, S, image, reply, run, sample


def test_before_anything_there_is_no_time_base() -> None:
    clocks = Clocks()
    assert clocks.offset_ns is None
    assert clocks.source == "none"
    assert clocks.align(image(EPOCH + 5 * S, EPOCH + 5 * S, Clock.HOST)).message is None
    assert clocks.align(image(5 * S, EPOCH + 5 * S)).message is None
    assert clocks.rejected == {"no_time_base": 2}


def test_offset_from_arrivals_is_that_of_the_fastest() -> None:
    clocks = Clocks()
    for i, late in enumerate((30, 5, 2, 90, 17)):
        t = (1000 + 20 * i) * MS
        clocks.align(sample(t, EPOCH + t + late * MS))
    assert clocks.offset_ns == EPOCH + 2 * MS
    assert clocks.source == "arrival"


def test_timesync_beats_arrivals_and_is_exact_when_both_ways_take_as_long() -> None:
    clocks = Clocks()
    run(clocks, 5, 1)
    clocks.receive_reply(reply(6 * S, 1 * MS, 1 * MS))
    assert clocks.source == "timesync"
    assert clocks.offset_ns is not None
    assert abs(clocks.offset_ns - EPOCH) <= 1000  # the tag costs up to half a microsecond
    assert clocks.round_trip_ns == pytest.approx(2 * MS, abs=1000)
    clocks.align(sample(6 * S, EPOCH + 6 * S + 1))
    assert clocks.source == "timesync"


def test_the_reply_of_the_shortest_round_trip_counts() -> None:
    clocks = Clocks()
    run(clocks, 5, 1)
    for out, back in ((1, 40), (1, 1), (60, 1)):
        clocks.receive_reply(reply(6 * S, out * MS, back * MS))
    assert clocks.offset_ns is not None
    assert abs(clocks.offset_ns - EPOCH) <= 1000


def test_requests_are_no_replies() -> None:
    clocks = Clocks()
    run(clocks, 5, 1)
    clocks.receive_reply(replace(reply(6 * S, MS, MS), tc1_ns=0))
    assert clocks.source == "arrival"


def test_replies_to_others_do_not_count_once_ours_come() -> None:
    clocks = Clocks()
    run(clocks, 5, 1)
    for i in range(3):
        clocks.receive_reply(reply((6 + i) * S, 1 * MS, 1 * MS))
    ours = clocks.offset_ns
    clocks.receive_reply(reply(9 * S, 50_000, 50_000, tag=7, host_ns=EPOCH + 100 * MS))
    assert clocks.offset_ns == ours
    assert clocks.rejected["timesync_not_ours"] == 1


def test_a_reply_with_our_tag_by_chance_does_not_exclude_the_others_in_a_log() -> None:
    """One in a thousand does; the recorded formation flight holds two."""
    clocks = Clocks()
    for i in range(600):
        run(clocks, 5 + 0.2 * i, 0.2)
        tag = TIMESYNC_TAG_NS if i in (20, 300) else i % 100
        clocks.receive_reply(reply(round((5.2 + 0.2 * i) * S), MS, MS, tag=tag))
    assert clocks.source == "timesync"
    assert len(clocks._offset.replies) > 40
    assert not clocks.rejected


def test_when_ours_stop_the_others_serve_again() -> None:
    clocks = Clocks()
    for i in range(60):
        run(clocks, 5 + i, 1)
        clocks.receive_reply(reply((6 + i) * S, MS, MS, tag=TIMESYNC_TAG_NS if i < 10 else 7))
    assert clocks.source == "timesync"
    assert 5 <= clocks.rejected["timesync_not_ours"] <= 10


def test_untagged_replies_serve_a_log_until_tagged_ones_come() -> None:
    clocks = Clocks()
    run(clocks, 5, 1)
    clocks.receive_reply(reply(6 * S, MS, MS, tag=0, host_ns=EPOCH + 10 * MS))
    assert clocks.offset_ns == pytest.approx(EPOCH + 10 * MS, abs=1000)
    for i in range(3):
        clocks.receive_reply(reply((6 + i) * S, 5 * MS, 5 * MS))
    assert clocks.offset_ns == pytest.approx(EPOCH, abs=1000)


@pytest.mark.parametrize("round_trip_ms", [-5, 201, 5000])
def test_impossible_round_trips_are_rejected(round_trip_ms: int) -> None:
    clocks = Clocks()
    run(clocks, 5, 1)
    before = clocks.offset_ns
    clocks.receive_reply(reply(6 * S, 0, round_trip_ms * MS))
    assert clocks.offset_ns == before
    assert clocks.rejected["timesync_not_ours"] == 1


def test_without_replies_for_long_the_arrivals_serve_again() -> None:
    """A stale reply drifts away from the truth: 150 ppm are 90 ms in ten minutes."""
    clocks = Clocks()
    run(clocks, 5, 1)
    clocks.receive_reply(reply(6 * S, MS, MS))
    run(clocks, 6, 30, host_ns=EPOCH + 6 * MS)
    assert clocks.source == "arrival"
    assert clocks.offset_ns == EPOCH + 6 * MS


@pytest.mark.parametrize("timesync", [True, False])
def test_a_slow_drift_of_150_ppm_is_followed(timesync: bool) -> None:
    clocks = Clocks()
    worst = 0.0
    rng = np.random.default_rng(6)
    for step in range(50 * 600):
        boot = 5 * S + step * 20 * MS
        drift = round((boot - 5 * S) * 150e-6)
        late = round(rng.exponential(3.0) * MS)
        assert clocks.align(sample(boot, EPOCH + boot + drift + MS + late)).message is not None
        if timesync and step % 50 == 0:
            clocks.receive_reply(reply(boot, MS, MS, host_ns=EPOCH + drift))
        if step > 500:
            assert clocks.offset_ns is not None
            worst = max(worst, abs(clocks.offset_ns - (EPOCH + drift)))
    assert clocks.reboots == 0
    assert worst < (1.6 * MS if timesync else 3 * MS)  # 10 s of drift are 1.5 ms
