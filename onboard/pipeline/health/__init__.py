"""What the health reports: counts and rates (`monitor`), which camera messages are refused (`refusals`), and
what to do about all that is wrong (`advice`)."""

from onboard.pipeline.health.advice import Advisor
from onboard.pipeline.health.monitor import Exceptions, Monitor, autopilot_name, sender_of, total
from onboard.pipeline.health.needs import LinkNeed, Needs
from onboard.pipeline.health.refusals import Refusals

__all__ = [
    "Advisor",
    "Exceptions",
    "LinkNeed",
    "Monitor",
    "Needs",
    "Refusals",
    "autopilot_name",
    "sender_of",
    "total",
]
