"""Setpoints behind the leader: one law, and a record for each autopilot."""

from onboard.autopilot.guidance.autopilots import GUIDED as GUIDED
from onboard.autopilot.guidance.autopilots import OFFBOARD as OFFBOARD
from onboard.autopilot.guidance.autopilots import SetpointMode as SetpointMode
from onboard.autopilot.guidance.autopilots import setpoint_mode as setpoint_mode
from onboard.autopilot.guidance.guidance import Follower as Follower
from onboard.autopilot.guidance.guidance import Guidance as Guidance
from onboard.autopilot.guidance.law import Phase as Phase
from onboard.autopilot.guidance.law import ReferenceState as ReferenceState
