"""From an estimate of the leader to setpoints for an autopilot: one law, and a record for each autopilot."""

from onboard.autopilot.guidance.autopilots import GUIDED, OFFBOARD, SetpointMode, setpoint_mode
from onboard.autopilot.guidance.guidance import Follower, Guidance
from onboard.autopilot.guidance.law import Phase, ReferenceState

__all__ = [
    "GUIDED",
    "OFFBOARD",
    "Follower",
    "Guidance",
    "Phase",
    "ReferenceState",
    "SetpointMode",
    "setpoint_mode",
]
