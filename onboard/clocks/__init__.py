"""One time base for all messages (`clocks`), by the offset between two clocks (`offset`)."""

from onboard.clocks.clocks import LONGEST_ROUND_TRIP_NS, SENSED, ClockEvent, Clocks

__all__ = ["LONGEST_ROUND_TRIP_NS", "SENSED", "ClockEvent", "Clocks"]
