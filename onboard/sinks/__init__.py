"""Sinks: where records go, each behind its own bounded queue."""
