"""The history of beliefs by itself: a belief that counts milliseconds, and measurements that add to it."""

from typing import Any

import pytest

from onboard.estimators.kit.history import History

MS = 1_000_000


class Motion:
    """Samples each 10 ms until a time."""

    def __init__(self, until_ms: int) -> None:
        self.nav_times = [k * MS for k in range(0, until_ms + 1, 10)]

    def knows(self, t_ns: int) -> bool:
        return t_ns <= self.nav_times[-1]


def advance(belief: tuple[float, ...], t0_ns: int, t1_ns: int, _: Motion) -> tuple[float, ...]:
    return (belief[0] + (t1_ns - t0_ns) / MS, *belief[1:])


def fuse(belief: tuple[float, ...], measurement: float, _: Motion) -> tuple[Any, float]:
    return (*belief, measurement), 10 * measurement


def history() -> History[tuple[float, ...], Motion]:
    return History(0, (0.0,), horizon_ns=100 * MS, advance=advance, fuse=fuse)


def test_a_late_measurement_gives_the_belief_of_one_in_order() -> None:
    one, two = history(), history()
    for each, order in ((one, (20, 40)), (two, (40, 20))):
        for t_ms in order:
            assert each.insert(t_ms * MS, float(t_ms), Motion(60)) == 10.0 * t_ms
            each.settle(Motion(60))
    assert one.nodes[-1].belief == two.nodes[-1].belief == (60.0, 20.0, 40.0)
    assert one.belief_at(65 * MS, Motion(60)) == (65 * MS, (65.0, 20.0, 40.0))
    assert one.belief_at(5 * MS, Motion(60)) == (60 * MS, (60.0, 20.0, 40.0)), "the newest one"
    assert two.belief_before(30 * MS, Motion(60)) == (30.0, 20.0)
    assert one.newest(lambda outcome: outcome < 300.0) == 20 * MS
    assert one.newest(lambda outcome: outcome > 500.0) is None


def test_what_is_older_than_the_horizon_is_dropped_but_for_the_node_before_it() -> None:
    one = history()
    one.settle(Motion(200))
    assert one.nodes[-1].belief == (200.0,)
    assert one.reaches(100 * MS)
    assert not one.reaches(99 * MS)
    assert one.belief_before(99 * MS, Motion(200)) is None


@pytest.mark.parametrize("known_ms", [30, 60])
def test_a_measurement_beyond_the_known_motion_is_judged_again_once_it_is_known(known_ms: int) -> None:
    one = history()
    one.insert(45 * MS, 45.0, Motion(known_ms))
    assert one.settle(Motion(known_ms)) is False
    assert one.settle(Motion(80)) is (known_ms < 45)
    assert one.nodes[-1].belief == (80.0, 45.0)
