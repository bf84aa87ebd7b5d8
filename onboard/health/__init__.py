"""What the health reports: counts and rates (`monitor`), and which camera messages are refused (`refusals`)."""

from onboard.health.monitor import Errors, Monitor, autopilot_name, total
from onboard.health.refusals import Refusals

__all__ = ["Errors", "Monitor", "Refusals", "autopilot_name", "total"]
