"""Sinks: outputs of records, each with its own bounded queue and thread.

`console` prints lines for a person.
"""

from onboard.sinks.sink import BoundedQueue, Sink, SinkError, SinkRunner

__all__ = ["BoundedQueue", "Sink", "SinkError", "SinkRunner"]
