"""Our own state between the records of it: what it is compared with comes at times of its own."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from operator import attrgetter
from typing import Final

from msgspec.structs import replace

from onboard.messages.estimates import NavState

SAME_NS: Final = 6_000_000  # a record so near is of the same time: stamps are whole milliseconds
LONGEST_STEP_NS: Final = 50_000_000  # from one record to the next
LINEAR: Final = 6  # components of the mean: position and velocity


def nav_state_at(states: Sequence[NavState], t_ns: int) -> NavState | None:
    """The state of a time, or else position, velocity and attitude between its neighbours, with the rest as in the
    nearer one; `states` in order, of which those without a mean do not count. None where there is none."""
    after = bisect_left(states, t_ns, key=attrgetter("t_ns"))
    around = [s for s in states[max(after - 1, 0) : after + 1] if s.mean is not None and s.q_nb is not None]
    if not around:
        return None
    near, *others = sorted(around, key=lambda s: abs(s.t_ns - t_ns))
    if abs(near.t_ns - t_ns) <= SAME_NS:
        return near
    if not others or abs(others[0].t_ns - near.t_ns) > LONGEST_STEP_NS:
        return None
    far = others[0]
    if near.mean is None or far.mean is None or near.q_nb is None or far.q_nb is None:
        return None
    share = (t_ns - near.t_ns) / (far.t_ns - near.t_ns)
    moved = [a + share * (b - a) for a, b in zip(near.mean[:LINEAR], far.mean, strict=False)]
    sign = math.copysign(share, sum(a * b for a, b in zip(near.q_nb, far.q_nb, strict=True)))
    w, x, y, z = (a * (1.0 - share) + b * sign for a, b in zip(near.q_nb, far.q_nb, strict=True))
    n = math.hypot(w, x, y, z)
    return replace(near, t_ns=t_ns, mean=(*moved, *near.mean[LINEAR:]), q_nb=(w / n, x / n, y / n, z / n))
