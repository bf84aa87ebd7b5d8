"""Sinks: where records go, each behind its own bounded queue and in its own thread."""

from onboard.sinks.sink import BoundedQueue, Sink, SinkError, SinkRunner

__all__ = ["BoundedQueue", "Sink", "SinkError", "SinkRunner"]
