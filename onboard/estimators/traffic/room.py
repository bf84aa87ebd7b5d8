"""Limit on the number of tracks with an address.

A sender that floods us with addresses costs distant aircraft their tracks, not near ones.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.reports import Report
from onboard.estimators.traffic.track import Track

MIN_DISTANCE_RATIO: Final = 1.2  # An aircraft nearer by this factor takes another's place.


def make_room(
    tracks: Sequence[Track], r: Array, own_r: Array, reports: Sequence[Report], most: int
) -> tuple[list[int], list[Report]]:
    """Return the tracks that give way to nearer aircraft, and the reports with room.

    At most `most` tracks may have an address. The tracks are at r (k, 3), and we are at `own_r` (3,). Only
    `reports` are known yet of the nearer aircraft.
    """
    rows = [i for i, track in enumerate(tracks) if track.key is not None]
    known = {tracks[i].key for i in rows}
    new = [k for k, report in enumerate(reports) if report.key not in known]
    free = max(0, most - len(rows))
    if len(new) <= free:
        return [], [*reports]
    near = sorted(new, key=lambda k: float(np.linalg.norm(reports[k].y[:3] - own_r)))
    far = sorted(rows, key=lambda i: -float(np.linalg.norm(r[i] - own_r)))
    gone = []
    for k, i in zip(near[free:], far, strict=False):
        if np.linalg.norm(r[i] - own_r) <= MIN_DISTANCE_RATIO * np.linalg.norm(reports[k].y[:3] - own_r):
            break
        gone.append(i)
    refused = {*near[free + len(gone) :]}
    return gone, [report for k, report in enumerate(reports) if k not in refused]
