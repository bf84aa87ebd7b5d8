"""Health of the daemon: counts and rates (`monitor`), refused messages (`refusals`), and advice (`advice`)."""

from onboard.health.advice import Advisor
from onboard.health.monitor import Exceptions, Monitor, autopilot_name, sender_of, total
from onboard.health.needs import LinkNeed, Needs
from onboard.health.refusals import Refusals

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
