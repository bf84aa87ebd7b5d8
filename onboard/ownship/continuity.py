"""Whether one sender's motion continues that of another, so that both are one vehicle."""

import math
from typing import Final

from onboard.geometry.geodesy import ned_from_geodetic
from onboard.messages import Attitude, GlobalPosition, LocalPosition, Message
from onboard.units import S_PER_NS

MAX_LAG_CHANGE_NS: Final = 200_000_000  # of stamps behind arrivals
POSITION_TOLERANCE_M: Final = 2.0  # from where both velocities lead
POSITION_TOLERANCE_RATE: Final = 1.0  # m/s^2; a change of acceleration adds to the tolerance.
VELOCITY_TOLERANCE_M_S: Final = 2.0
VELOCITY_TOLERANCE_RATE: Final = 5.0  # m/s^2
ANGLE_TOLERANCE: Final = 0.3  # rad
ANGLE_TOLERANCE_RATE: Final = 1.5  # rad/s


def goes_on(before: Message, after: Message) -> bool:
    """Whether the second message continues the motion of the first.

    Positions are compared by arrival, since some autopilots stamp them by another clock. Attitudes must also
    continue the first one's clock."""
    t = (after.t_recv_ns - before.t_recv_ns) * S_PER_NS
    if isinstance(before, Attitude) and isinstance(after, Attitude):
        lag_ns = (after.t_recv_ns - after.t_ns) - (before.t_recv_ns - before.t_ns)
        cosine = abs(sum(a * b for a, b in zip(before.q_nb, after.q_nb, strict=True)))
        return (
            abs(lag_ns) < MAX_LAG_CHANGE_NS
            and 2.0 * math.acos(min(1.0, cosine)) < ANGLE_TOLERANCE + ANGLE_TOLERANCE_RATE * t
        )
    if isinstance(before, LocalPosition) and isinstance(after, LocalPosition):
        way = [b - a for a, b in zip(before.r_OF_n, after.r_OF_n, strict=True)]
    elif isinstance(before, GlobalPosition) and isinstance(after, GlobalPosition):
        start, end = ((p.lat_deg, p.lon_deg, p.alt_msl) for p in (before, after))
        way = ned_from_geodetic(end, start).tolist()
    else:
        return False
    led = [0.5 * t * (u + v) for u, v in zip(before.v_F_n, after.v_F_n, strict=True)]
    is_as_fast = math.dist(before.v_F_n, after.v_F_n) < VELOCITY_TOLERANCE_M_S + VELOCITY_TOLERANCE_RATE * t
    return is_as_fast and math.dist(way, led) < POSITION_TOLERANCE_M + POSITION_TOLERANCE_RATE * t**2
