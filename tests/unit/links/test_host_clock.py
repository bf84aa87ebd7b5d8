"""The clock of arrivals and timers, while the wall clock is set."""

import pytest

from onboard.links.host_clock import HostClock

MS = 1_000_000
S = 1_000_000_000
STEPS = [sign * s for s in (0.01, 0.5, 3.0, 3600.0, 3 * 365 * 86400.0) for sign in (-1, 1)]


class Clocks:
    """A wall clock that is set, and one that is not."""

    def __init__(self) -> None:
        self.passed_ns = 0
        self.set_by_ns = 0

    def wall(self) -> int:
        return 1_735_689_600 * S + self.passed_ns + self.set_by_ns

    def monotonic(self) -> int:
        return 77 * S + self.passed_ns


@pytest.mark.parametrize("step", STEPS)
def test_time_goes_on_evenly_and_the_step_is_known(step: float) -> None:
    clocks = Clocks()
    clock = HostClock(wall=clocks.wall, monotonic=clocks.monotonic)
    begin = clock.now_ns()
    assert begin == clocks.wall()
    clocks.passed_ns += 5 * S
    assert clock.step_ns() == 0
    clocks.set_by_ns = round(step * S)
    clocks.passed_ns += 5 * S
    assert clock.now_ns() == begin + 10 * S
    assert clock.step_ns() == round(step * S)


def test_what_the_clocks_differ_by_chance_is_no_step() -> None:
    clocks = Clocks()
    clock = HostClock(wall=clocks.wall, monotonic=clocks.monotonic)
    for k in range(100):
        clocks.set_by_ns = (k % 3 - 1) * 300_000
        assert clock.step_ns() == 0


def test_a_reading_that_was_interrupted_is_no_step() -> None:
    clocks = Clocks()
    clock = HostClock(wall=clocks.wall, monotonic=clocks.monotonic)
    honest = clocks.wall

    def late() -> int:
        clocks.passed_ns += 20 * MS
        return honest()

    clock._wall = late
    assert clock.step_ns() == 0
