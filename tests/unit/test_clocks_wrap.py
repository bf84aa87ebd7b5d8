"""Boot time in 32 bits of milliseconds wraps after 49.7 days; the same autopilot's 64-bit stamps go on."""

from collections.abc import Iterator

import pytest

from onboard.clocks import Clocks
from onboard.messages import ActuatorOutputs, Clock, Imu, Message
from tests.support.clock_messages import EPOCH, MS, image, reply, sample

WRAP = 2**32 * MS


def imu(t_ns: int, t_recv_ns: int) -> Imu:
    return Imu(t_ns=t_ns, t_recv_ns=t_recv_ns, f_b=(0, 0, 0), omega_b=(0, 0, 0))


def flight(
    begin_s: float, end_s: float, *, wide: bool = True, servo: bool = False
) -> Iterator[tuple[int, Message]]:
    """(true boot time, message) around the wrap, s from it: 32-bit positions, 64-bit IMU, servo outputs."""
    for ms in range(round(begin_s * 1000), round(end_s * 1000), 20):
        true = WRAP + ms * MS
        recv = EPOCH + true + 2 * MS
        yield true, sample(true % WRAP, recv)
        if wide:
            yield true, imu(true, recv)
        if servo:
            yield true, ActuatorOutputs(t_ns=true // 1000 % 2**32 * 1000, t_recv_ns=recv, pwm_us=(1500,))


@pytest.mark.parametrize("wide", [True, False])
@pytest.mark.parametrize("servo", [True, False])
def test_nothing_is_lost_at_the_wrap(wide: bool, servo: bool) -> None:
    clocks = Clocks()
    for true, message in flight(-5, 20, wide=wide, servo=servo):
        aligned = clocks.align(message).message
        assert aligned is not None
        assert aligned.t_ns == true
    assert clocks.reboots == 0
    assert not clocks.rejected


@pytest.mark.parametrize("begin_s", [10.0, 86_400.0])
def test_a_daemon_that_starts_after_the_wrap_brings_both_kinds_of_stamps_together(begin_s: float) -> None:
    clocks = Clocks()
    stamps = []
    for true, message in flight(begin_s, begin_s + 5):
        aligned = clocks.align(message).message
        assert aligned is not None
        stamps.append(aligned.t_ns - true)
    assert set(stamps) == {-WRAP}
    assert clocks.reboots == 0


@pytest.mark.parametrize("begin_s", [-5.0, 10.0])
def test_timesync_and_images_follow_the_wrap(begin_s: float) -> None:
    clocks = Clocks()
    for true, message in flight(begin_s, begin_s + 20):
        aligned = clocks.align(message).message
        assert aligned is not None
        base = aligned.t_ns - true
        if (true - WRAP) % (200 * MS) == 0:
            clocks.receive_reply(reply(true, MS, MS))
            assert clocks.offset_ns is not None
            assert abs(clocks.offset_ns - (EPOCH - base)) <= 1000
        for stamped in (
            image(EPOCH + true, EPOCH + true + 60 * MS, Clock.HOST),
            image(true, EPOCH + true + 60 * MS),
        ):
            seen = clocks.align(stamped).message
            assert seen is not None
            assert abs(seen.t_ns - aligned.t_ns) <= 3 * MS
    assert clocks.source == "timesync"
