"""INAV and Betaflight write microseconds into the milliseconds of GLOBAL_POSITION_INT."""

import pytest

from onboard.clocks import Clocks
from onboard.messages import GlobalPosition
from tests.support.clock_messages import EPOCH, MS, S, sample

WRAP_US = 2**32


def position(stamp_ns: int, t_recv_ns: int) -> GlobalPosition:
    return GlobalPosition(
        t_ns=stamp_ns,
        t_recv_ns=t_recv_ns,
        lat_deg=47.0,
        lon_deg=8.0,
        alt_msl=500.0,
        height=50.0,
        v_F_n=(1.0, 0.0, 0.0),
        heading_rad=None,
    )


@pytest.mark.parametrize("begin_s", [40, 4290, 20_000])
def test_microseconds_for_milliseconds_are_read_so_also_beyond_their_wrap(begin_s: int) -> None:
    """As often as other messages, and the first: they never begin a time base, which nothing else would fit."""
    clocks, found = Clocks(), 0
    for ms in range(begin_s * 1000, begin_s * 1000 + 20_000, 100):
        true, recv = ms * MS, EPOCH + ms * MS + 2 * MS
        aligned = clocks.align(position(ms * 1000 % WRAP_US * MS, recv)).message
        if aligned is not None:
            assert aligned.t_ns == true
            found += 1
        assert clocks.align(sample(true + MS, recv + MS)).message is not None
    assert (found, clocks.reboots) == (199, 0)
    assert clocks.rejected == {"no_time_base": 1, "microseconds_for_milliseconds": 199}


def test_milliseconds_stay_milliseconds_and_an_odd_stamp_odd() -> None:
    clocks = Clocks()
    clocks.align(sample(40 * S, EPOCH + 40 * S))
    fits = clocks.align(position(40 * S + 10 * MS, EPOCH + 40 * S + 10 * MS)).message
    assert fits is not None
    assert fits.t_ns == 40 * S + 10 * MS
    assert clocks.align(position(90 * S, EPOCH + 40 * S + 20 * MS)).message is None
    assert clocks.rejected == {"odd_stamp": 1}
