"""Clocks that step, restart, drift apart or wrap."""

import math

import numpy as np
import pytest

from onboard.clocks import Clocks
from onboard.messages import ActuatorOutputs, Message
from tests.support.clock_messages import EPOCH, MS, S, reply, run, sample


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
    assert clocks.align(sample((102 + odd_s) * S, EPOCH + 102 * S)).message is None
    assert run(clocks, 102, 5) == 250
    assert clocks.reboots == 0
    assert clocks.rejected == {"odd_stamp": 1}
    assert clocks.offset_ns == EPOCH + 2 * MS


def test_a_clock_that_was_set_forward_is_noticed_when_messages_stay_late() -> None:
    clocks = Clocks()
    run(clocks, 100, 5)
    assert run(clocks, 105, 2, host_ns=EPOCH + 2 * MS + 2 * S) == 100
    assert clocks.offset_ns == EPOCH + 2 * MS
    assert run(clocks, 107, 3, host_ns=EPOCH + 2 * MS + 2 * S) == 150
    assert clocks.offset_ns == EPOCH + 2 * MS + 2 * S
    assert clocks.rejected == {"host_clock_steps": 1}


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
        assert clocks.align(sample(ms * MS, resumed)).message is not None
    assert run(clocks, 108, 2) == 100
    assert clocks.reboots == 0
    assert clocks.offset_ns == EPOCH + 2 * MS


def test_servo_stamps_of_32_bits_are_unwrapped() -> None:
    clocks = Clocks()
    hour = 2 * 3600.0
    run(clocks, hour, 2)
    for i in range(10):
        boot_us = round((hour + 2) * 1e6) + 20_000 * i
        message: Message = ActuatorOutputs(
            t_ns=boot_us % 2**32 * 1000, t_recv_ns=EPOCH + boot_us * 1000 + 2 * MS, pwm_us=(1500,)
        )
        aligned = clocks.align(message).message
        assert aligned is not None
        assert aligned.t_ns == boot_us * 1000
    assert clocks.reboots == 0
    assert not clocks.rejected


def test_state_does_not_grow_with_time() -> None:
    clocks = Clocks()
    rng = np.random.default_rng(1)
    for i in range(1_500):  # three times what it keeps
        t = 5 * S + i * 20 * MS
        clocks.align(sample(t, EPOCH + t + round(rng.exponential() * 5 * MS)))
        clocks.receive_reply(reply(t, MS, MS))
        assert len(clocks._offset.fastest) < 100
        assert len(clocks._offset.replies) <= math.ceil(10 / 0.02) + 1
