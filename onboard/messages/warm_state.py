"""What one run of the daemon leaves to the next."""

from typing import Final

from onboard.messages.base import Message
from onboard.messages.estimates import Estimate, OwnPose
from onboard.messages.vehicle import Heartbeat

WARM_VERSION: Final = 2  # of the record: another one is not read


class WarmState(Message, frozen=True, kw_only=True):
    """The last valid estimate of the leader, true at `t_ns` on the autopilot's boot clock, which was `wall_ns` on
    the wall clock. It is of use to a run with the same `configuration`, while the autopilot runs on."""

    version: int
    configuration: str  # digest of what decides the meaning of an estimate (`config.warm_start`)
    wall_ns: int
    heartbeat: Heartbeat  # of the autopilot
    estimate: Estimate
    own: OwnPose  # at the estimate's time
    course: float | None  # rad, of the leader; None before it has flown
    led: bool  # the autopilot was led by setpoints
    offset_ns: int  # wall clock minus boot clock
    round_trip_ns: int | None  # of the TIMESYNC reply that the offset is known by; None: it is known by arrivals
