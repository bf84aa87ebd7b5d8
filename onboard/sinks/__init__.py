"""Sinks: outputs of records, each with its own bounded queue and thread; and lines for a person (`console`)."""

from onboard.sinks.sink import BoundedQueue, Sink, SinkError, SinkRunner

__all__ = ["BoundedQueue", "Sink", "SinkError", "SinkRunner"]
