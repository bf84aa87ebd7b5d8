"""One time base: offsets, steps of our clock, reboots of theirs, and stamps that lie."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.clocks import OUR_TAG, Clocks, tagged
from onboard.messages import ActuatorOutputs, Clock, LocalPosition, Message, TargetPoints, TimeSync

MS = 1_000_000
S = 1_000_000_000
EPOCH = 1_735_689_600 * S


def sample(t_ns: int, t_recv_ns: int) -> LocalPosition:
    return LocalPosition(t_ns=t_ns, t_recv_ns=t_recv_ns, r_OF_n=(0, 0, 0), v_F_n=(0, 0, 0))


def image(t_ns: int, t_recv_ns: int, clock: Clock = Clock.BOOT) -> TargetPoints:
    at = (0.0, 0.0)
    return TargetPoints(t_ns=t_ns, t_recv_ns=t_recv_ns, clock=clock, camera="c", center=at, left=at, right=at)


def run(clocks: Clocks, start_s: float, seconds: float, host_ns: int = EPOCH + 2 * MS, period_ms: int = 20) -> int:
    """Samples every 20 ms; how many came through."""
    through = 0
    for ms in range(round(start_s * 1000), round((start_s + seconds) * 1000), period_ms):
        through += clocks.align(sample(ms * MS, host_ns + ms * MS)) is not None
    return through


def reply(boot_ns: int, out_ns: int, back_ns: int, *, host_ns: int = EPOCH, tag: int = OUR_TAG) -> TimeSync:
    """A reply made at boot time `boot_ns`, asked for `out_ns` before and heard `back_ns` after."""
    ts1 = host_ns + boot_ns - out_ns
    ts1 += tag - ts1 % 1000
    recv = host_ns + boot_ns + back_ns
    return TimeSync(t_ns=recv, t_recv_ns=recv, clock=Clock.NONE, tc1_ns=boot_ns, ts1_ns=ts1)


# ------------------------------------------------------------------------------------- offset


def test_before_anything_there_is_no_time_base() -> None:
    clocks = Clocks()
    assert clocks.offset_ns is None
    assert clocks.source == "none"
    assert clocks.align(image(EPOCH + 5 * S, EPOCH + 5 * S, Clock.HOST)) is None
    assert clocks.align(image(5 * S, EPOCH + 5 * S)) is None
    assert clocks.rejected == {"no_time_base": 2}


def test_offset_from_arrivals_is_that_of_the_fastest() -> None:
    clocks = Clocks()
    for i, late in enumerate((30, 5, 2, 90, 17)):
        t = (1000 + 20 * i) * MS
        clocks.align(sample(t, EPOCH + t + late * MS))
    assert clocks.offset_ns == EPOCH + 2 * MS
    assert clocks.source == "arrival"


def test_host_stamps_are_carried_over_by_the_offset_less_their_delay() -> None:
    clocks = Clocks()
    clocks.align(sample(5 * S, EPOCH + 5 * S))
    aligned = clocks.align(image(EPOCH + 5 * S + 7 * MS, EPOCH + 6 * S, Clock.HOST), delay_ns=3 * MS)
    assert aligned is not None
    assert aligned.t_ns == 5 * S + 4 * MS
    assert aligned.clock is Clock.BOOT


def test_delay_is_taken_off_boot_stamps() -> None:
    aligned = Clocks().align(sample(5 * S, EPOCH), delay_ns=22_500_000)
    assert aligned is not None
    assert aligned.t_ns == 5 * S - 22_500_000


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


def test_a_reply_that_bears_our_tag_by_chance_does_not_silence_the_others_in_a_log() -> None:
    """One in a thousand does; the recorded formation flight holds two."""
    clocks = Clocks()
    for i in range(600):
        run(clocks, 5 + 0.2 * i, 0.2)
        clocks.receive_reply(reply(round((5.2 + 0.2 * i) * S), MS, MS, tag=OUR_TAG if i in (20, 300) else i % 100))
    assert clocks.source == "timesync"
    assert len(clocks._synced) > 40
    assert not clocks.rejected


def test_when_ours_stop_the_others_serve_again() -> None:
    clocks = Clocks()
    for i in range(60):
        run(clocks, 5 + i, 1)
        clocks.receive_reply(reply((6 + i) * S, MS, MS, tag=OUR_TAG if i < 10 else 7))
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
def test_round_trips_that_cannot_be_are_rejected(round_trip_ms: int) -> None:
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
    run(clocks, 6, 30, host_ns=EPOCH + 20 * MS)
    assert clocks.source == "arrival"
    assert clocks.offset_ns == EPOCH + 20 * MS


def test_a_tag_keeps_the_time_to_a_microsecond() -> None:
    for now in (EPOCH, EPOCH + 999, EPOCH + 123_456_789):
        assert tagged(now) % 1000 == OUR_TAG
        assert abs(tagged(now) - now) < 1000


@pytest.mark.parametrize("timesync", [True, False])
def test_a_slow_drift_of_150_ppm_is_followed(timesync: bool) -> None:
    clocks = Clocks()
    worst = 0.0
    rng = np.random.default_rng(6)
    for step in range(50 * 600):
        boot = 5 * S + step * 20 * MS
        drift = round((boot - 5 * S) * 150e-6)
        late = round(rng.exponential(3.0) * MS)
        assert clocks.align(sample(boot, EPOCH + boot + drift + MS + late)) is not None
        if timesync and step % 50 == 0:
            clocks.receive_reply(reply(boot, MS, MS, host_ns=EPOCH + drift))
        if step > 500:
            assert clocks.offset_ns is not None
            worst = max(worst, abs(clocks.offset_ns - (EPOCH + drift)))
    assert clocks.reboots == 0
    assert worst < (1.6 * MS if timesync else 3 * MS)  # 10 s of drift are 1.5 ms


# ------------------------------------------------------------------- our clock steps, theirs restarts


@pytest.mark.parametrize("step_s", [-86400, -30, -3, 3, 30, 86400])
def test_a_step_of_our_own_clock_loses_nothing(step_s: int) -> None:
    clocks = Clocks()
    assert run(clocks, 5, 5) == 250
    clocks.receive_reply(reply(10 * S, MS, MS))
    assert run(clocks, 10, 5, host_ns=EPOCH + 2 * MS + step_s * S) == 250
    assert clocks.offset_ns == EPOCH + 2 * MS + step_s * S
    assert clocks.reboots == 0
    assert clocks.rejected == {"host_clock_steps": 1}


def test_a_reboot_is_confirmed_by_a_few_messages_and_counted() -> None:
    clocks = Clocks()
    run(clocks, 100, 5)
    lost = 250 - run(clocks, 3, 5, host_ns=EPOCH + 110 * S)
    assert clocks.reboots == 1
    assert 0 < lost <= 5
    assert clocks.rejected == {"odd_stamp": lost}
    assert clocks.offset_ns == EPOCH + 110 * S


def test_a_reboot_forgets_the_replies_before_it() -> None:
    clocks = Clocks()
    run(clocks, 100, 5)
    clocks.receive_reply(reply(105 * S, MS, MS))
    run(clocks, 3, 1, host_ns=EPOCH + 110 * S)
    assert clocks.source == "arrival"
    assert clocks.offset_ns == EPOCH + 110 * S


@pytest.mark.parametrize("odd_s", [-90, -2, 2, 4, 60, 4_000_000])
def test_a_lone_odd_stamp_is_rejected_and_leaves_no_trace(odd_s: int) -> None:
    clocks = Clocks()
    run(clocks, 100, 2)
    assert clocks.align(sample((102 + odd_s) * S, EPOCH + 102 * S)) is None
    assert run(clocks, 102, 5) == 250
    assert clocks.reboots == 0
    assert clocks.rejected == {"odd_stamp": 1}
    assert clocks.offset_ns == EPOCH + 2 * MS


def test_odd_stamps_now_and_then_never_add_up_to_a_reboot() -> None:
    clocks = Clocks()
    for i in range(20):
        run(clocks, 100 + i, 1)
        clocks.align(sample(3 * S, EPOCH + (101 + i) * S))
    assert clocks.reboots == 0
    assert clocks.rejected == {"odd_stamp": 20}


def test_messages_held_up_on_their_way_are_neither_a_reboot_nor_lost() -> None:
    clocks = Clocks()
    run(clocks, 100, 5)
    resumed = EPOCH + 108 * S
    for ms in range(105_000, 108_000, 20):  # three seconds' worth at once
        assert clocks.align(sample(ms * MS, resumed)) is not None
    assert run(clocks, 108, 2) == 100
    assert clocks.reboots == 0
    assert clocks.offset_ns == EPOCH + 2 * MS


def test_a_gap_after_held_up_messages_is_no_reboot() -> None:
    """The first of a stall's messages, then none (the socket's buffer was full), then the newest."""
    clocks = Clocks()
    run(clocks, 100, 5)
    for ms in range(105_000, 105_500, 20):
        clocks.align(sample(ms * MS, EPOCH + 109 * S))
    assert run(clocks, 109.0, 2) >= 96
    assert clocks.reboots == 0
    assert clocks.offset_ns == EPOCH + 2 * MS


@pytest.mark.parametrize("lead_s", [-5.0, 0.5, 1.5, 3.0, 30.0])
def test_a_camera_whose_clock_is_off_does_not_bend_the_time_base(lead_s: float) -> None:
    clocks = Clocks()
    for i in range(100):
        run(clocks, 100 + 0.04 * i, 0.04)
        t = 100 * S + 40 * MS * i
        seen = clocks.align(image(t + round(lead_s * S), EPOCH + t + 60 * MS))
        assert seen is not None
        assert seen.t_ns == t + round(lead_s * S)
    assert clocks.offset_ns == EPOCH + 2 * MS
    assert clocks.reboots == 0
    assert not clocks.rejected


def test_servo_stamps_of_32_bits_are_unwrapped() -> None:
    clocks = Clocks()
    hour = 2 * 3600.0
    run(clocks, hour, 2)
    for i in range(10):
        boot_us = round((hour + 2) * 1e6) + 20_000 * i
        message: Message = ActuatorOutputs(
            t_ns=boot_us % 2**32 * 1000, t_recv_ns=EPOCH + boot_us * 1000 + 2 * MS, pwm_us=(1500,)
        )
        aligned = clocks.align(message)
        assert aligned is not None
        assert aligned.t_ns == boot_us * 1000
    assert clocks.reboots == 0
    assert not clocks.rejected


def test_state_does_not_grow_with_time() -> None:
    clocks = Clocks()
    rng = np.random.default_rng(1)
    for i in range(20_000):
        t = 5 * S + i * 20 * MS
        clocks.align(sample(t, EPOCH + t + round(rng.exponential() * 5 * MS)))
        clocks.receive_reply(reply(t, MS, MS))
        assert len(clocks._fastest) < 100
        assert len(clocks._synced) <= math.ceil(10 / 0.02) + 1
