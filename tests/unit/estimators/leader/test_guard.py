"""The last check of what is published: by the wing's apparent size, and by what was published seconds ago."""

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.tracks.doubts import Guard
from onboard.filters.belief import Belief
from onboard.models.relative_motion import SIZE
from onboard.ownship import Ownship, Step

TENTH = 100_000_000
START = 20_000_000_000
WING = 2.0  # m


class Flying:
    """We fly to the north at a constant velocity, m/s."""

    def __init__(self, speed: float) -> None:
        self.v = np.array([speed, 0.0, 0.0])

    def steps(self, t0_ns: int, t1_ns: int) -> Sequence[Step]:
        return [Step((t1_ns - t0_ns) * 1e-9, self.v, self.v, np.zeros(3))]


def belief(range_: float, sigma: float, closing: float = 0.0) -> Belief:
    """A leader to the north; `closing` m/s."""
    mean: Array = np.zeros(9)
    mean[0], mean[3], mean[SIZE] = range_, -closing, WING
    return Belief(mean, np.diag([sigma**2, 0.1, 0.1, 0.04, 0.04, 0.04, 1.0, 1.0, 1.0]))


def watched(
    ranges: Callable[[float], Belief], seconds: float, *, speed: float = 0.0, span: float | None = None
) -> str:
    """What is contradicted in the end, if this is published at ten Hz."""
    guard, found = Guard(), None
    for k in range(round(10 * seconds)):
        now = ranges(0.1 * k)
        guard.seen(WING / now.mean[0] if span is None else span, 0.001)
        found = guard.contradiction(START + k * TENTH, now, cast("Ownship", Flying(speed)))
    return "" if found is None else found.words


def test_a_leader_that_stays_or_comes_nearer_as_published_passes() -> None:
    assert watched(lambda _: belief(30.0, 0.5), 6.0) == ""
    assert watched(lambda t: belief(60.0 - 8.0 * t, 0.5, closing=8.0), 5.0) == ""
    # we fly towards one that stands
    assert watched(lambda t: belief(60.0 - 8.0 * t, 0.5, closing=8.0), 5.0, speed=8.0) == ""


@pytest.mark.parametrize("end", [8.0, 60.0])
def test_a_range_that_moves_farther_than_its_covariances_allow_is_contradicted(end: float) -> None:
    """As in the hover collapse: from 30 m to 8 m in two seconds, sure of it all the way, and at rest."""

    def collapse(t: float) -> Belief:
        return belief(float(np.interp(t, [2.0, 4.0], [30.0, end])), 0.5)

    assert watched(collapse, 5.0, span=0.01) == "the range contradicts what was published 3 s ago"
    assert watched(collapse, 9.0, span=0.01) == ""  # what was published since agrees again


def test_a_range_that_was_open_may_move() -> None:
    def resolved(t: float) -> Belief:
        range_, sigma = np.interp(t, [2.0, 4.0], [70.0, 20.0]), np.interp(t, [2.0, 4.0], [20.0, 0.5])
        return belief(float(range_), float(sigma))

    assert watched(resolved, 5.0, span=0.01) == ""


def test_a_leader_that_brakes_passes() -> None:
    """2 m/s^2, of which its motion model knows nothing."""
    assert watched(lambda t: belief(30.0 + t * t, 0.5, closing=-2.0 * t), 4.0) == ""


def test_a_wing_that_looks_larger_than_broadside_is_contradicted() -> None:
    assert watched(lambda _: belief(30.0, 0.5), 2.0, span=WING / 24.0) == "the wing looks too large for its range"
    assert watched(lambda _: belief(30.0, 3.0), 2.0, span=WING / 24.0) == ""  # 24 m is two sigmas off
    assert watched(lambda _: belief(30.0, 0.5), 2.0, span=WING / 60.0) == ""  # seen from the side


def test_a_new_track_is_not_held_to_an_old_one() -> None:
    guard, flying = Guard(), cast("Ownship", Flying(0.0))
    for k in range(35):
        guard.contradiction(START + k * TENTH, belief(30.0, 0.5), flying)
    guard.clear()
    for k in range(35, 70):
        assert guard.contradiction(START + k * TENTH, belief(60.0, 0.5), flying) is None
