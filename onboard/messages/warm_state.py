"""State that one run of the daemon leaves to the next."""

from typing import Final

from onboard.messages.base import Message
from onboard.messages.estimates import Estimate, OwnPose
from onboard.messages.vehicle import Heartbeat

WARM_VERSION: Final = 2  # records of another version are ignored


class WarmState(Message, frozen=True, kw_only=True):
    """The last valid estimate of the leader, for the next run of the daemon.

    It is true at `t_ns` on the autopilot's boot clock, which was `wall_ns` on the wall clock. It is useful only to
    a run with the same `configuration`, while the autopilot keeps running.
    """

    version: int
    configuration: str  # digest of the settings that an estimate depends on (`config.warm_start`)
    wall_ns: int
    heartbeat: Heartbeat  # of the autopilot
    estimate: Estimate
    own: OwnPose  # at the estimate's time
    course: float | None  # rad, of the leader; None before it has flown
    led: bool  # setpoints were being sent to the autopilot
    offset_ns: int  # wall clock minus boot clock
    round_trip_ns: int | None  # of the TIMESYNC reply that gave the offset; None: arrivals gave it
