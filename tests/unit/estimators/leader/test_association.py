"""Which detection of an exposure is of which track, by costs; and what becomes of images that may be of either."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.association import associate
from onboard.estimators.leader.assumptions import AMBIGUOUS_COST
from onboard.messages import Estimate, Message, TargetPoints, Verdict
from onboard.messages.causes import Cause
from tests.support.streams import Run, S, Stream, advance, position_error

APART = 0.12  # rad: the second aircraft is so far to the right in the image
EXCHANGED_NS = 9 * S


def test_all_are_associated_together_not_each_with_the_nearest() -> None:
    """Both detections are nearest to the first track; the second one fits it hardly worse than the other track."""
    costs = {(0, 0): 1.0, (0, 1): 3.0, (1, 0): 14.0, (1, 1): 8.0}
    assert associate(costs) == ({0: 0, 1: 1}, {})


def test_a_track_takes_no_detection_that_hardly_fits_to_leave_another_one_its_own() -> None:
    costs = {(0, 0): 1.0, (0, 1): 16.0, (1, 0): 15.0}
    assert associate(costs).decided == {0: 0}


@pytest.mark.parametrize(("more", "is_open"), [(0.5 * AMBIGUOUS_COST, True), (1.5 * AMBIGUOUS_COST, False)])
def test_two_that_may_as_well_be_exchanged_are_open(more: float, is_open: bool) -> None:
    costs = {(0, 0): 1.0, (1, 1): 1.0, (0, 1): 1.0 + 0.5 * more, (1, 0): 1.0 + 0.5 * more}
    found = associate(costs)
    assert (sorted(found.open), sorted(found.decided)) == (([0, 1], []) if is_open else ([], [0, 1]))


@pytest.mark.parametrize(("more", "is_open"), [(0.5 * AMBIGUOUS_COST, True), (1.5 * AMBIGUOUS_COST, False)])
def test_one_that_may_be_of_either_of_two_is_open(more: float, is_open: bool) -> None:
    assert bool(associate({(0, 0): 1.0, (1, 0): 1.0 + more}).open) is is_open


def test_one_track_beside_two_detections_takes_the_better_one() -> None:
    assert associate({(0, 0): 1.0, (0, 1): 1.1}) == ({0: 0}, {})


def test_nothing_is_associated_with_nothing() -> None:
    assert associate({}) == ({}, {})


def beside(m: TargetPoints, by: float) -> TargetPoints:
    """Another aircraft of the same size."""
    center, left, right = ((u + by, v) for u, v in (m.center, m.left, m.right))
    return replace(m, center=center, left=left, right=right)


def of(run: Run, target: str) -> list[Estimate]:
    return [e for e in run.estimates if e.target == target]


def test_of_exchanged_ids_no_track_follows_the_other_aircraft_seed_1() -> None:
    messages: list[Message] = []
    for m in (item.message for item in Stream(t1=12.0, sparse=True).items()):
        if isinstance(m, TargetPoints):
            names = ("leader", "other") if m.t_ns < EXCHANGED_NS else ("other", "leader")
            two = replace(m, target=names[0]), replace(beside(m, APART), target=names[1])
            messages += two if m.t_ns < EXCHANGED_NS else reversed(two)
        else:
            messages.append(m)
    run = advance(messages)
    late = [e for e in of(run, "leader") if e.t_ns > EXCHANGED_NS]
    assert max(position_error(e) for e in late if e.valid) < 2.6
    assert (late[-1].valid, late[-1].cause) == (False, Cause.LEAPT)


def test_an_image_that_may_be_of_either_of_two_aircraft_is_used_for_none_seed_2() -> None:
    """Two without ids come together from both sides, and stay for 0.4 s where none can tell them apart."""
    messages: list[Message] = []
    meets = 10.0
    for m in (item.message for item in Stream(t1=13.0, seed=2, sparse=True).items()):
        if isinstance(m, TargetPoints):
            t = m.t_ns / S
            by = 0.15 * math.copysign(max(abs(t - meets) - 0.2, 0.0), meets - t)
            messages += [replace(beside(m, by), target=""), replace(beside(m, -by), target="")]
        else:
            messages.append(m)
    run = advance(messages)
    refused = [r.t_ns / S for r in run.reports if r.verdict is Verdict.UNASSOCIATED]
    assert refused, "an image is used although it may be of either"
    assert np.all(np.abs(np.array(refused) - meets) < 1.0)
