"""From an estimate of the leader to what an autopilot's follow mode can fly; a file for each autopilot."""

from onboard.autopilot.guidance.ardupilot import ArduPilot
from onboard.autopilot.guidance.follower import Follower
from onboard.autopilot.guidance.guidance import Guidance
from onboard.autopilot.guidance.px4 import Px4
from onboard.config import GuidanceConfig
from onboard.messages.mavlink_enums import PX4

__all__ = ["Guidance", "follower_of"]


def follower_of(autopilot: int, config: GuidanceConfig) -> Follower:
    """The follow mode of a MAV_AUTOPILOT. Others than PX4 are led as ArduPilot is."""
    return Px4(config) if autopilot == PX4 else ArduPilot(config)
