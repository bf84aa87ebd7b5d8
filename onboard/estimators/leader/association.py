"""Which detection of an exposure is of which track.

Global nearest neighbour, over all of them together.

A cost is minus twice the log-likelihood that a track gives a detection (`hypotheses.belief.ImageComparison.cost`).
Where another assignment is about as likely, which gives a track another detection, none of the tracks in question
gets any: for a moment they are predicted, instead of following each other's aircraft."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from onboard.estimators.leader.assumptions import AMBIGUOUS_COST

Costs = Mapping[tuple[int, int], float]  # of each pair of a track and a detection that may be of it


class Association(NamedTuple):
    """The track of each detection that has one, and of each that may as well be of another."""

    decided: dict[int, int]
    open: dict[int, int]


def associate(costs: Costs) -> Association:
    """Each detection with at most one track, and each track with at most one detection."""
    if not costs:
        return Association({}, {})
    missed = max(costs.values()) + 1.0  # of a track without a detection: any that may be of it is likelier
    track_of = _assigned(costs, missed)
    detection_of = {track: detection for detection, track in track_of.items()}
    undecided: set[int] = set()
    for (track, detection), cost in costs.items():
        mine = track_of.get(detection, track)
        if mine == track:
            continue
        other = detection_of.get(track)
        now = costs[mine, detection] + (missed if other is None else costs[track, other])
        then = cost + (missed if other is None else min(costs.get((mine, other), missed), missed))
        if then - now < AMBIGUOUS_COST:
            undecided |= {detection} if other is None else {detection, other}
    decided = {detection: track for detection, track in track_of.items() if detection not in undecided}
    return Association(decided, {detection: track_of[detection] for detection in undecided})


def _assigned(costs: Costs, missed: float) -> dict[int, int]:
    """The track of each detection that has one, where a track without a detection costs so much."""
    # With one track and one detection there is nothing to choose, and most flights load no SciPy.
    from onboard.filters.association import assign  # noqa: PLC0415 - a quarter of a second

    pairs = list(costs)
    tracks = sorted({track for track, _ in pairs})
    nothing = 1 + max(i for _, i in pairs)  # the first number of those that stand for no detection
    pairs += [(track, nothing + k) for k, track in enumerate(tracks)]
    array = np.array(pairs)
    each = np.array([*costs.values(), *[missed] * len(tracks)])
    found = zip(*(x.tolist() for x in assign(array[:, 0].copy(), array[:, 1].copy(), each)), strict=True)
    return {i: track for track, i in found if i < nothing}
