"""Interpolation of our own state between its records."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from operator import attrgetter
from typing import Final

from msgspec.structs import replace

from onboard.messages.estimates import NavState

STAMP_TOLERANCE_NS: Final = 6_000_000  # Stamps are whole milliseconds: a nearer record has the same time.
MAX_RECORD_INTERVAL_NS: Final = 50_000_000  # Longer gaps are not interpolated.
LINEAR_STATES: Final = 6  # Position and velocity are the first components of the mean.


def nav_state_at(states: Sequence[NavState], t_ns: int) -> NavState | None:
    """Return our own state at a time, interpolated between its two neighbours.

    Position, velocity and attitude are interpolated; everything else is that of the nearer record. `states` are in
    order of time, and those without a mean are ignored. Returns None if no neighbour is near enough.
    """
    after = bisect_left(states, t_ns, key=attrgetter("t_ns"))
    around = [s for s in states[max(after - 1, 0) : after + 1] if s.mean is not None and s.q_nb is not None]
    if not around:
        return None
    near, *others = sorted(around, key=lambda s: abs(s.t_ns - t_ns))
    if abs(near.t_ns - t_ns) <= STAMP_TOLERANCE_NS:
        return near
    if not others or abs(others[0].t_ns - near.t_ns) > MAX_RECORD_INTERVAL_NS:
        return None
    far = others[0]
    if near.mean is None or far.mean is None or near.q_nb is None or far.q_nb is None:
        return None
    share = (t_ns - near.t_ns) / (far.t_ns - near.t_ns)
    moved = [a + share * (b - a) for a, b in zip(near.mean[:LINEAR_STATES], far.mean, strict=False)]
    sign = math.copysign(share, sum(a * b for a, b in zip(near.q_nb, far.q_nb, strict=True)))
    w, x, y, z = (a * (1.0 - share) + b * sign for a, b in zip(near.q_nb, far.q_nb, strict=True))
    n = math.hypot(w, x, y, z)
    return replace(near, t_ns=t_ns, mean=(*moved, *near.mean[LINEAR_STATES:]), q_nb=(w / n, x / n, y / n, z / n))
