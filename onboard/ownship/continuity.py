"""Whether motion goes on where that of another sender ended: it is then the same vehicle."""

import math
from typing import Final

from onboard.geometry.geodesy import ned_from_geodetic
from onboard.messages import Attitude, GlobalPosition, LocalPosition, Message
from onboard.units import S_PER_NS

CLOCK_NS: Final = 200_000_000  # by which stamps may lag behind arrivals more or less than before
POSITION_M: Final = 2.0  # from where both velocities lead ...
LEAP_PER_S: Final = 1.0  # m/s^2: ... and by as much more as acceleration changes meanwhile
VELOCITY_M_S: Final = 2.0
LEAP_SLACK: Final = 5.0  # m/s^2
TURN: Final = 0.3  # rad
RATE_SLACK: Final = 1.5  # rad/s


def goes_on(before: Message, after: Message) -> bool:
    """Whether motion goes on, by arrivals: some stamp positions otherwise. An attitude's clock does, too."""
    t = (after.t_recv_ns - before.t_recv_ns) * S_PER_NS
    if isinstance(before, Attitude) and isinstance(after, Attitude):
        lag_ns = (after.t_recv_ns - after.t_ns) - (before.t_recv_ns - before.t_ns)
        cosine = abs(sum(a * b for a, b in zip(before.q_nb, after.q_nb, strict=True)))
        return abs(lag_ns) < CLOCK_NS and 2.0 * math.acos(min(1.0, cosine)) < TURN + RATE_SLACK * t
    if isinstance(before, LocalPosition) and isinstance(after, LocalPosition):
        way = [b - a for a, b in zip(before.r_OF_n, after.r_OF_n, strict=True)]
    elif isinstance(before, GlobalPosition) and isinstance(after, GlobalPosition):
        start, end = ((p.lat_deg, p.lon_deg, p.alt_msl) for p in (before, after))
        way = ned_from_geodetic(end, start).tolist()
    else:
        return False
    led = [0.5 * t * (u + v) for u, v in zip(before.v_F_n, after.v_F_n, strict=True)]
    is_as_fast = math.dist(before.v_F_n, after.v_F_n) < VELOCITY_M_S + LEAP_SLACK * t
    return is_as_fast and math.dist(way, led) < POSITION_M + LEAP_PER_S * t**2
