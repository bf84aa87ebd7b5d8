"""One time base for all messages (`clocks`), by the offset between two clocks (`offset`)."""

from onboard.clocks.clocks import MAX_ROUND_TRIP_TIME_NS, SENSED, ClockEvent, Clocks

__all__ = ["MAX_ROUND_TRIP_TIME_NS", "SENSED", "ClockEvent", "Clocks"]
